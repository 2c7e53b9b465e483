"""Names of computed files: the digest of everything that determines their content."""

from __future__ import annotations

from eres_render.sequence.manifest import RENDER_VERSION
from eres_render.storage.digest import digest as whole_digest

# Raise the number of a stage when its results change, so that older files are not reused.
STAGE_VERSIONS = {"render": RENDER_VERSION, "simulate": 1, "evaluate": 3}


def digest(values: dict[str, object]) -> str:
    """Return the name of a file that these values determine, 20 hexadecimal digits."""
    return whole_digest(values)[:20]
