"""The public names of eres in one module, which works beside a user's own `sensor` or `tasks`.

A script finds modules in its own folder first, so a `tasks.py` there hides the package `tasks`.
This module loads `sensor`, `eres_render` and `tasks` from the folder in which it is installed.
Import it first; `from tasks.registry import TASKS` and the like then work as well.

>>> import eres_events as eres
>>> eres.find_camera("davis346").width
346
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_file_location
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eres_render import *  # noqa: F403
    from sensor import *  # noqa: F403
    from sensor.formats import *  # noqa: F403
    from sensor.representations import *  # noqa: F403
    from sensor.statistics import *  # noqa: F403
    from tasks.datasets import *  # noqa: F403

_FOLDER = Path(__file__).resolve().parent.parent
_PACKAGES = ("sensor", "eres_render", "tasks")
# Whose names are here; those that load least come first.
_MODULES = (
    "sensor",
    "eres_render",
    "sensor.formats",
    "sensor.representations",
    "sensor.statistics",
    "tasks.datasets",
)


def shadows(path: Iterable[str] | None = None) -> dict[str, Path]:
    """Return files with the name of one of the packages, which Python finds first, by that name.

    They are searched for in the folders of `path`, by default Python's up to that of eres.
    """
    files = {}
    folders = takewhile(lambda folder: Path(folder).resolve() != _FOLDER, path or sys.path)
    before = list(folders)
    for name in _PACKAGES:
        spec = PathFinder.find_spec(name, before)
        if spec is not None and spec.origin is not None:
            files[name] = Path(spec.origin).resolve()
    return files


def _pin(name: str) -> None:
    """Load a package from our folder, whatever else has its name."""
    init = _FOLDER / name / "__init__.py"
    if name in sys.modules:
        file = getattr(sys.modules[name], "__file__", None)
        if file is None or Path(file).resolve() != init:
            raise ImportError(
                f"{name!r} is already imported from {file}, which hides the package of eres in "
                f"{init.parent}; import eres_events first, or rename that file",
                name=name,
                path=file,
            )
        return
    spec = spec_from_file_location(name, init, submodule_search_locations=[str(init.parent)])
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


for _name in _PACKAGES:
    _pin(_name)
for _name, _file in shadows().items():
    warnings.warn(
        f"`import {_name}` gives {_FOLDER / _name} from now on, not {_file}; rename that file",
        stacklevel=2,
    )


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return __dir__()
    for module in map(import_module, _MODULES):
        if name in module.__all__:
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(name for module in _MODULES for name in import_module(module).__all__)
