"""What every test shares."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """A cache that starts empty, so that nothing from an earlier run decides a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ERES_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
