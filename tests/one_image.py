"""One image alone, which the engine measures, and whose pose it makes, as in a batch of one."""

import numpy as np

from aerodft.dft.measure import measure as measure_batch
from aerodft.dft.request import Request, Setup
from aerodft.model.measurement import Measurement
from aerodft.model.pose import PoseBatch, PoseSample
from aerodft.service.pose.source import PoseSource
from aerodft.service.streams import LAST


def measure(setup: Setup, sample: PoseSample, requests: tuple[Request, ...]) -> list[Measurement]:
    """What the requests come to."""
    return measure_batch(setup, PoseBatch.of([sample]), tuple(requests))[0]


def sample_at(poses: PoseSource, stamp_ns: int, *, final: bool, by_utc: bool = False) -> PoseSample | None:
    """The pose at a stamp (UTC) as of the last tick; None as long as telemetry that matters may still come."""
    asked = np.array([stamp_ns]), LAST
    found, is_pending = poses.at(*asked, final=np.array([final]), by_utc=np.array([by_utc]))
    return None if is_pending[0] else found[0]
