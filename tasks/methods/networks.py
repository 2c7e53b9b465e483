"""Networks of methods: loading them from files of weights, once for all sensors."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from eres_render.errors import suggestion
from eres_render.storage.checksums import sha256
from sensor.memory import memory_bytes
from tasks.errors import WeightsError
from tasks.registry import TASKS, load

_OURS = Path(__file__).parents[1] / "learned" / "weights"  # weights that come with eres
_KEPT = 4  # networks in memory
# Of the machine's memory; the rest is for sensors, frames, events and a network at work. A study
# with 90 sensors took 22.4 GB where networks kept 12.3 GB (docs/results.md).
_MAX_KEPT = 1 / 2


def network(task: str, name: str, weights: Mapping[str, str] | None) -> Any:
    """Return a method's network with its weights, the same object for the same file.

    Methods without a file in `weights` have the weights that come with eres, if there are any.
    """
    file = weights_of(name, weights)
    if file is None:
        raise WeightsError(
            f"{task}, method {name!r}: needs weights; give --weights {name}=FILE, or {name} under "
            "[weights] in the study's file"
        )
    return _loaded(TASKS[task].method(name).network, *_version(file))


def weights_of(name: str, weights: Mapping[str, str] | None = None) -> str | None:
    """Return the file of a network's weights."""
    if weights and name in weights:
        return weights[name]
    ours = _OURS / f"{name}.pt"
    return str(ours) if ours.exists() else None


def digest_of(file: str) -> str:
    """Return the SHA-256 of a file of weights, in hexadecimal digits."""
    return _digest(*_version(file))


def digests(weights: Mapping[str, str] | None, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of methods' files of weights, as they are now."""
    files = (weights_of(name, weights) for name in names)
    return {file: digest_of(file) for file in files if file}


def named_weights(given: Sequence[str], methods: Iterable[str]) -> dict[str, str]:
    """Return the file of weights of each method, from NAME=FILE or a bare FILE.

    A bare FILE is for the only method that needs weights, or else for the only network.
    """
    known = [name for spec in TASKS.values() for name in spec.networks]
    networks = [name for name in dict.fromkeys(methods) if name in known]
    asked = [name for name in networks if weights_of(name) is None] or networks
    files: dict[str, str] = {}
    for option in given:
        name, is_named, file = option.partition("=")
        if not is_named or os.sep in name:  # a folder's name may have an equals sign
            file = option
            if len(asked) != 1:
                expected = " or ".join(f"{name}={file}" for name in asked or known)
                raise WeightsError(f"weights: found {option!r}, expected {expected}")
            name = asked[0]
        if name not in networks or name in files:
            reason = "is not among the methods" if name in known else suggestion(name, known)
            reason = "has two files" if name in files else reason
            raise WeightsError(f"weights: {name!r}: {reason}")
        files[name] = str(Path(file).absolute())
    return files


@lru_cache(maxsize=_KEPT)
def _loaded(place: str, file: Path, mtime_ns: int, size: int) -> Any:
    return load(place)(file)


@lru_cache
def _digest(file: Path, mtime_ns: int, size: int) -> str:
    return sha256(file)


def _version(file: str) -> tuple[Path, int, int]:
    """Return a file with its modification time and size, as the key of the cache."""
    try:
        stat = Path(file).stat()
    except OSError as error:
        raise WeightsError(f"{file}: cannot be read: {error.strerror}") from None
    return Path(file), stat.st_mtime_ns, stat.st_size


def check_kept(needed: Mapping[str, int], sensors: int) -> None:
    """Refuse networks that keep, in bytes for all sensors, more than half of the memory."""
    if (total := sum(needed.values())) > _MAX_KEPT * memory_bytes():
        raise WeightsError(
            f"{' and '.join(needed)}: for {sensors} sensors (one for each light and speed) "
            f"networks keep {total / 1e9:.1f} GB in memory, more than half of this machine's "
            f"{memory_bytes() / 1e9:.1f} GB; choose fewer or smaller sensors, or run one network "
            "at a time"
        )
