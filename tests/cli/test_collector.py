"""The search for cyclic garbage is left as it was found, whatever happens in between."""

import gc
from collections.abc import Iterator

import pytest

from aerodft.cli.collector import keep_loaded, without_collector


@pytest.fixture(params=[True, False])
def was_enabled(request: pytest.FixtureRequest) -> Iterator[bool]:
    before = gc.isenabled()
    (gc.enable if request.param else gc.disable)()
    yield request.param
    (gc.enable if before else gc.disable)()


def test_as_it_was_found(was_enabled: bool) -> None:  # noqa: FBT001 - a fixture
    with without_collector():
        assert not gc.isenabled()
        with without_collector():
            pass
        assert not gc.isenabled()
    assert gc.isenabled() is was_enabled


def test_after_an_error(was_enabled: bool) -> None:  # noqa: FBT001 - a fixture
    with pytest.raises(OSError, match="full"), without_collector():
        raise OSError("full")
    assert gc.isenabled() is was_enabled


def test_what_is_loaded_is_not_looked_through_again() -> None:
    kept = [[each] for each in range(10_000)]
    assert any(each is kept[-1] for each in gc.get_objects())
    frozen = gc.get_freeze_count()
    keep_loaded()
    assert gc.get_freeze_count() > frozen + len(kept)
    assert len(gc.get_objects()) < 1000
