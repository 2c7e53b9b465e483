"""Make the sequences of a dataset on the workers of a Dask cluster, in a shared folder."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from tasks import DISTRIBUTION
from tasks.cluster import connected, outcome
from tasks.errors import TaskError
from tasks.generation.sequence import complete_sequence, sequence_folder
from tasks.generation.settings import FILE_NAME, DatasetSettings, claim_folder


def make_on_workers(
    address: str, settings: DatasetSettings, numbers: Sequence[int], out: Path
) -> Iterator[int]:
    """Make sequences on the workers of a Dask scheduler."""
    with connected(address) as client:
        from distributed import as_completed

        place, code = str(out.resolve()), version(DISTRIBUTION)
        number_of = {
            client.submit(_complete, settings, number, place, code, pure=False): number
            for number in numbers
        }
        for future in as_completed(number_of, loop=client.loop):
            outcome(future, f"sequence {number_of[future]}")
            yield number_of[future]


def _complete(settings: DatasetSettings, number: int, place: str, code: str) -> None:
    """Make a sequence on a worker, if it has the same code and sees the same folder."""
    out, here = Path(place), version(DISTRIBUTION)
    if here != code:
        raise TaskError(f"worker on {socket.gethostname()}: has eres {here}, expected {code}")
    if not (out / FILE_NAME).is_file():
        raise TaskError(f"worker on {socket.gethostname()}: cannot see the folder {out}")
    if sequence_folder(out, number).is_dir():  # by a worker that died before it said so
        return
    claim_folder(settings, out)
    complete_sequence(settings, number, out)
