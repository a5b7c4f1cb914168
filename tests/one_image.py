"""Measuring in one image alone, which the engine does as in a batch of one."""

from aerodft.dft.measure import Request, Setup
from aerodft.dft.measure import measure as measure_batch
from aerodft.model.measurement import Measurement
from aerodft.model.pose import PoseSample
from aerodft.model.pose_batch import PoseBatch


def measure(setup: Setup, sample: PoseSample, requests: tuple[Request, ...]) -> list[Measurement]:
    """What the requests come to."""
    return measure_batch(setup, PoseBatch.of([sample]), tuple(requests))[0]
