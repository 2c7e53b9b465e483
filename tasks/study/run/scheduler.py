"""What computes the jobs of a study: this process, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from tasks.cluster import connected
from tasks.study.run.cluster import Cluster
from tasks.study.run.local import ThisProcess

_log = logging.getLogger(__name__)


@contextmanager
def open_scheduler(address: str | None) -> Iterator[ThisProcess | Cluster]:
    """Open the Dask scheduler at an address; with None, this process computes the jobs."""
    if address is None:
        yield ThisProcess()
        return
    with connected(address) as client:
        cluster = Cluster(client)
        count = cluster.worker_count()
        if count:
            _log.info("workers at %s: %d", address, count)
        else:
            _log.warning("no workers at %s yet; waiting for one", address)
        yield cluster
