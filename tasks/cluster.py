"""The connection to a Dask cluster."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from tasks.errors import TaskError

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_S = 5.0


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Connect to the Dask scheduler at an address."""
    from distributed import Client

    if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", address):
        raise TaskError(f"--scheduler: found {address!r}, expected tcp://HOST:PORT")
    with ExitStack() as quiet:  # our error is a single line
        for name in ("distributed", "distributed.client"):
            logger = logging.getLogger(name)
            quiet.callback(logger.setLevel, logger.level)
            logger.setLevel(logging.CRITICAL)
        try:
            client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).partition("\n")[0] or f"no answer within {_CONNECT_S:g} s"
            raise TaskError(f"--scheduler: no Dask scheduler at {address}: {reason}") from None
        with client:
            yield client


def outcome(future: Future, what: str) -> Any:
    """Return the result of a future."""
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError

    try:
        return future.result()
    except KilledWorker as error:
        raise TaskError(
            f"{what}: one worker after another died, perhaps out of memory; the last was "
            f"{error.last_worker.address}"
        ) from None
    except FutureCancelledError:
        raise TaskError(f"{what}: the Dask scheduler ended or canceled the job") from None
