"""What every test shares."""

import sys

import pytest
from hypothesis import HealthCheck, settings

from tasks import cli

# Neither chance nor a busy machine decides a test; examples share a test's tmp_path.
settings.register_profile(
    "steady",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("steady")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """A cache that starts empty, so that nothing from an earlier run decides a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ERES_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def eres(monkeypatch, capsys):
    """Run the command in this process; returns (exit code, stdout, stderr)."""

    def run(*args):
        monkeypatch.setattr(sys, "argv", ["eres", *map(str, args)])
        monkeypatch.setattr(cli, "_out", cli.Console(width=250))
        monkeypatch.setattr(cli, "_err", cli.Console(stderr=True, width=250))
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
        output = capsys.readouterr()
        return code, output.out, output.err

    return run
