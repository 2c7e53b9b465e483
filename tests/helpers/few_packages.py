"""Python that finds only some packages, as where no others are installed."""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder

OURS = "eres_events", "eres_render", "sensor", "tasks"
BASE = {
    "docstring_parser": "docstring-parser",
    "PIL": "pillow",
    "yaml": "pyyaml",
    **{name: name for name in ("filelock", "h5py", "hdf5plugin", "jinja2", "numba", "numpy")},
    **{name: name for name in ("OpenEXR", "psutil", "rich", "scipy", "tyro")},
}
"""Import names of what pyproject.toml requires without an extra, and their distributions."""
NEEDED = (
    *("llvmlite", "markdown_it", "markupsafe", "mdurl", "pygments", "typeguard"),
    "typing_extensions",
)
"""What these require."""
_VERSIONS = "drjit", "mitsuba", "opencv-python-headless"  # that eres asks for


def find_only(*packages: str) -> None:
    """Hide all packages but these and the standard library, and what `version` finds of extras."""
    found = {*packages, *sys.stdlib_module_names}

    class Few(PathFinder):
        @classmethod
        def find_spec(cls, name, path=None, target=None):
            known = name.partition(".")[0] in found or name.startswith("_sysconfigdata")
            return PathFinder.find_spec(name, path, target) if known else None

        @classmethod
        def find_distributions(cls, *context):
            every = PathFinder.find_distributions(*context)
            return (one for one in every if one.metadata["Name"] not in _VERSIONS)

    sys.meta_path[sys.meta_path.index(PathFinder)] = Few
