"""Write files of weights, and read them without running code from them."""

from __future__ import annotations

import io
import pickle
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Self, TypeVar

import torch
from torch import Tensor, nn

from eres_render.errors import reading
from eres_render.storage.atomic import write_bytes
from sensor.growth import check_growth
from tasks.errors import WeightsError

N = TypeVar("N", bound=nn.Module)

_SHOWN = 4  # names that a message lists


def write_checkpoint(file: Path, content: Mapping[str, Any]) -> None:
    """Write a file that `read_checkpoint` reads."""
    data = io.BytesIO()  # PyTorch reports a full disk as a RuntimeError without the reason
    torch.save(content, data)
    write_bytes(file, data.getbuffer())


class _Inert:
    """Stands for an object of another program: takes what a pickle gives it, and keeps nothing."""

    def __new__(cls, *arguments: Any) -> Self:
        return super().__new__(cls)

    def __setstate__(self, state: Any) -> None:
        pass


def read_checkpoint(file: Path, left_out: Iterable[str] = ()) -> Any:
    """Read a file that `write_checkpoint` or `torch.save` wrote.

    Only tensors and plain values are read, since a pickle of other classes could run code. Objects
    of the classes in `left_out`, "module.name", are empty; the code of these classes is not even
    imported.
    """
    classes = (name.rpartition(".") for name in left_out)
    empty = [type(name, (_Inert,), {"__module__": module}) for module, _, name in classes]
    with reading(file, "a PyTorch checkpoint", WeightsError):
        _check_entries(file)
        try:
            with torch.serialization.safe_globals(empty):
                return torch.load(file, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError as error:
            if not (names := re.findall(r"GLOBAL ([\w.]+)", str(error))):
                raise
            raise WeightsError(
                f"{file}: found a pickle of {_listed(dict.fromkeys(names))}, which could run "
                "code, expected tensors and plain values. If you trust the file, load it with the "
                "program that wrote it, and save only its weights and options"
            ) from None


def _check_entries(file: Path) -> None:
    """Refuse damaged entries of a zip file; PyTorch does not check them.

    Files of PyTorch before 1.6 are no zip files and have no checksums.
    """
    if not zipfile.is_zipfile(file):
        return
    with zipfile.ZipFile(file) as entries:
        for entry in entries.infolist():
            check_growth(entry.file_size, entry.compress_size)
        damaged = entries.testzip()
    if damaged is not None:
        raise WeightsError(f"{file}: is damaged: {damaged} does not match its checksum")


def tensors_of(content: Any, file: Path) -> dict[str, Tensor]:
    """Return a state dict from the content of a checkpoint."""
    entries = content.items() if isinstance(content, Mapping) else ()
    if not entries or not all(isinstance(k, str) and isinstance(v, Tensor) for k, v in entries):
        raise WeightsError(f"{file}: found {held(content)}, expected tensors by name")
    return dict(entries)


def held(content: Any) -> str:
    """Describe what a checkpoint holds."""
    if isinstance(content, Mapping):
        architecture = f"arch {content['arch']!r} and " if "arch" in content else ""
        entries = "1 entry" if len(content) == 1 else f"{len(content)} entries"
        return f"a table with {architecture}{entries}: {_listed(map(str, content))}"
    return f"a {type(content).__name__}"


def with_weights(make: Callable[[], N], state: Mapping[str, Tensor], file: Path) -> N:
    """Make a network on the device "meta", and put weights into it."""
    with torch.device("meta"):
        network = make()
    tensors = network.state_dict()
    for name in {**tensors, **state}:
        value, expected = _shape(state.get(name)), _shape(tensors.get(name))
        if value != expected:
            raise WeightsError(f"{file}: {name}: found {value}, expected {expected}")
    network.load_state_dict(
        {name: _as(state[name], tensors[name].dtype, name, file) for name in tensors}, assign=True
    )
    return network


def _as(tensor: Tensor, dtype: torch.dtype, name: str, file: Path) -> Tensor:
    """Return finite values of a type."""
    if tensor.is_floating_point() != dtype.is_floating_point:
        raise WeightsError(f"{file}: {name}: found {tensor.dtype} values, expected {dtype} values")
    values = tensor.to(dtype)  # before the check: what is finite in more bits may be too large
    if not torch.isfinite(values).all():
        raise WeightsError(f"{file}: {name}: found values that are not finite in {dtype}")
    return values


def _shape(tensor: Tensor | None) -> str:
    return "no entry" if tensor is None else f"shape {tuple(tensor.shape)}"


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
