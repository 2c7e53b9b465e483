"""Names of artifacts: a digest of everything that decides them."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from tasks.study.settings import plain

# Raise a stage's number when its results change, so that artefacts made before are not taken for
# its own.
STAGE_VERSIONS = {"render": 3, "simulate": 1, "evaluate": 3}


def digest(values: dict[str, Any]) -> str:
    """Name of what these values decide: 20 hexadecimal digits of the SHA-256 of their JSON."""
    text = json.dumps(plain(values), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:20]
