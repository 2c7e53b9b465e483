"""Code of others: a user's modules, and what installed distributions add by entry points."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from functools import cache
from types import ModuleType
from typing import TypeVar

T = TypeVar("T")


def import_own(module: str) -> ModuleType:
    """Import a user's module, also from the working directory, as `python -m` does."""
    if "" not in sys.path and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return importlib.import_module(module)


@cache
def installed(group: str, prefix: str = "") -> Mapping[str, str]:
    """Return the places of a group's entry points, by what follows the prefix in their names."""
    from importlib.metadata import entry_points

    points = (point for point in entry_points(group=group) if point.name.startswith(prefix))
    return {point.name.removeprefix(prefix): point.value for point in points}


class WithInstalled(MutableMapping[str, T]):
    """Entries by name, then those of installed distributions, looked up when needed."""

    def __init__(self, given: Mapping[str, T], more: Callable[[], Mapping[str, T]]) -> None:
        self._given, self._more = dict(given), cache(more)

    def __getitem__(self, name: str) -> T:
        return self._given[name] if name in self._given else self._more()[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._given
        yield from (name for name in self._more() if name not in self._given)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __setitem__(self, name: str, entry: T) -> None:
        self._given[name] = entry

    def __delitem__(self, name: str) -> None:
        del self._given[name]
