"""Fixtures and settings of all tests."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parent.parent


# Ignored where the tests run in the background or under `nohup`; tests send them.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if signal.getsignal(getattr(signal, _name)) == signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)

# Read when NumPy is imported: the small problems of tests are slower on several threads, and two
# workers share the machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from browser import CHROMIUM  # noqa: E402
from eres_render import load_scene  # noqa: E402
from light_scenes import light_evenly, small_carpet_folder  # noqa: E402
from tasks import cli  # noqa: E402
from tasks.cli import terminal  # noqa: E402

# Property tests do not depend on chance or on a busy machine; examples share a test's tmp_path.
settings.register_profile(
    "steady",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("steady")


# Files that take long, the longest first, so that no worker is left alone with one at the end. One
# worker compiles the sensor's kernels while another makes the textures of the scenes.
FIRST = (
    "sensor/test_simulate.py",
    "eres_render/test_scenes.py",
    "tasks/test_cli_light.py",
    "tasks/test_view.py",  # the last of all by name
    "study/test_run.py",
    "tasks/rig/test_virtual_rig.py",
    "tasks/test_fitting.py",
    "tasks/test_generation.py",
    "tasks/test_training.py",
    "study/test_report.py",
)


def pytest_collection_modifyitems(items):
    """Put the tests of `FIRST` first; the Makefile tells xdist to keep the order."""
    places = {ROOT / "tests" / file: place for place, file in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


def pytest_collection_finish():
    """Leave modules and tests out of later garbage collections: 0.08 s each in place of 0.26 s."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Start with an empty cache, so that no earlier run affects a test.

    The workers of a run share the textures and the list of Mitsuba variants that work.
    """
    cache, run = tmp_path_factory.mktemp("cache"), tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        for shared in ("textures", "variants"):
            (run.parent / shared).mkdir(exist_ok=True)
            (cache / shared).symlink_to(run.parent / shared)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ERES_CACHE", str(cache))
        yield


@pytest.fixture(scope="module")
def scene_folder(tmp_path_factory):
    """Write a small carpet that is baked when it is rendered."""
    return small_carpet_folder(tmp_path_factory.mktemp("scenes") / "carpet")


@pytest.fixture(scope="module")
def small_carpet(tmp_path_factory):
    """Load a small carpet in even light, which needs no baking on any machine."""
    folder = small_carpet_folder(tmp_path_factory.mktemp("scenes") / "small_carpet")
    return load_scene(light_evenly(folder, "carpet", 3.0))


@pytest.fixture
def unmeasured_noise(monkeypatch):
    """Do not measure the noise of path-traced renders, in tests of other things."""
    monkeypatch.setattr("eres_render.sequence.render_clips.warn_of_noise", lambda *_: None)


@pytest.fixture(scope="module")
def one_torch_thread():
    """Let networks compute on one thread: so small ones are slower on several."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: make .venv/.learned")
    from tasks.learned import cpu

    threads = torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cpu, "cores", lambda: 1)
        cpu._helpers.cache_clear()
        torch.set_num_threads(1)
        yield
    cpu._helpers.cache_clear()
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def chromium():
    """Start a browser; skip the test where there is none."""
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


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
