"""Names of artifacts: a digest of everything that decides them."""

from __future__ import annotations

from eres_render.storage.digest import digest as whole_digest

# Raise a stage's number when its results change, so that artefacts made before are not taken for
# its own.
STAGE_VERSIONS = {"render": 3, "simulate": 1, "evaluate": 3}


def digest(values: dict[str, object]) -> str:
    """Return the name of what these values decide, 20 hexadecimal digits."""
    return whole_digest(values)[:20]
