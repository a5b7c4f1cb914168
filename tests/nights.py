"""Which cases of a test wait for the night."""

import pytest


def at_night(*cases):
    """Cases of ``parametrize`` that only ``make nightly`` runs; of several names, each is a tuple of values."""
    values = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*each, marks=pytest.mark.nightly) for each in values]
