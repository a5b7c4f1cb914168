import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.geometry.interpolation import bracket

STAMPS = np.array([0, 100, 200, 1200], dtype=np.int64)


@pytest.mark.parametrize("stamp", [-1, 1201])
def test_nothing_outside(stamp):
    assert bracket(STAMPS, stamp, 10_000) is None


def test_nothing_across_a_gap():
    assert bracket(STAMPS, 700, 999) is None
    assert bracket(STAMPS, 700, 1000) is not None


def test_a_sample_itself_needs_no_neighbour():
    found = bracket(STAMPS, 1200, 10)
    assert found is not None
    assert found.linear(np.array([1.0, 2.0, 3.0, 4.0])) == 4.0


def test_linear_between():
    found = bracket(STAMPS, 125, 1000)
    assert found is not None
    assert_allclose(found.linear(np.array([[0.0, 0], [1, 10], [2, 20], [0, 0]])), [1.25, 12.5])


def test_empty():
    assert bracket(np.empty(0, dtype=np.int64), 5, 10) is None
