"""Python that finds only some packages, as where no others are installed."""

from __future__ import annotations

import importlib.metadata
import sys
from importlib.machinery import PathFinder

OURS = "eres_events", "eres_render", "sensor", "tasks"
BASE = (
    *("docstring_parser", "filelock", "h5py", "hdf5plugin", "jinja2", "numba", "numpy", "OpenEXR"),
    *("PIL", "psutil", "rich", "scipy", "tyro", "yaml"),
)
"""Import names of what pyproject.toml requires without an extra."""
NEEDED = "llvmlite", "markdown_it", "markupsafe", "mdurl", "pygments", "typeguard"
"""What these require."""


def find_only(*packages: str) -> None:
    """Hide all packages but these and the standard library, and their versions."""
    found = {*packages, *sys.stdlib_module_names}
    owners = importlib.metadata.packages_distributions()
    hidden = {owner for top in owners if top not in found for owner in owners[top]}

    class Few(PathFinder):
        @classmethod
        def find_spec(cls, name, path=None, target=None):
            known = name.partition(".")[0] in found or name.startswith("_sysconfigdata")
            return PathFinder.find_spec(name, path, target) if known else None

        @classmethod
        def find_distributions(cls, *context):
            every = PathFinder.find_distributions(*context)
            return (one for one in every if one.metadata["Name"] not in hidden)

    sys.meta_path[sys.meta_path.index(PathFinder)] = Few
