"""Fixtures and settings of all tests."""

import hashlib
import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parent.parent


def compiled_folder():
    """Return the folder of Numba's cache: one for each worker and version of the kernels.

    Two processes must not write to the cache at once, and it does not notice a changed function in
    another file.
    """
    kernels = hashlib.sha256()
    for package in ("eres_render", "sensor", "tasks"):
        for file in sorted((ROOT / package).rglob("*.py")):
            code = file.read_bytes()
            if b"numba" in code or b"jit" in code:
                kernels.update(code)
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    return ROOT / "build" / "numba" / f"{worker}-{kernels.hexdigest()[:12]}"


os.environ["NUMBA_CACHE_DIR"] = str(compiled_folder())  # read when Numba is imported

from tasks import cli  # noqa: E402
from tasks.cli import terminal  # noqa: E402

# Neither chance nor a busy machine decides a property test; examples share a test's tmp_path.
settings.register_profile(
    "steady",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("steady")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Start with an empty cache, so that no earlier run decides a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ERES_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def eres(monkeypatch, capsys):
    """Return a function that runs the command in this process: (exit code, stdout, stderr)."""

    def run(*args):
        monkeypatch.setattr(sys, "argv", ["eres", *map(str, args)])
        monkeypatch.setattr(terminal, "out", terminal.Console(width=250))
        monkeypatch.setattr(terminal, "err", terminal.Console(stderr=True, width=250))
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
        output = capsys.readouterr()
        return code, output.out, output.err

    return run
