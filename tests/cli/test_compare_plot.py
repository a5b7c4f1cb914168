"""The picture of two recordings' differences: no band where there was nothing to compare."""

import numpy as np
from matplotlib import pyplot as plt

from aerodft.reports.style import with_gaps


def test_a_band_ends_where_nothing_was_measured() -> None:
    seconds = np.concatenate([np.arange(0, 5, 0.1), np.arange(12, 15, 0.1), np.arange(15.1, 20, 0.2)])
    at_s, std = with_gaps(seconds, np.full(len(seconds), 0.5))
    assert np.isnan(std).sum() == 1
    assert at_s[np.isnan(std)].tolist() == [12.0]
    figure, axes = plt.subplots()
    spans = [path.get_extents().intervalx.tolist() for path in axes.fill_between(at_s, -std, std).get_paths()]
    plt.close(figure)
    np.testing.assert_allclose(spans, [[0.0, 4.9], [12.0, 19.9]], atol=1e-9)


def test_few_and_none_are_left_as_they_are() -> None:
    for count in (0, 1, 2):
        at_s, std = with_gaps(np.arange(float(count)), np.ones(count))
        assert (at_s.tolist(), std.tolist()) == (list(range(count)), [1.0] * count)
