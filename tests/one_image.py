"""One image alone, which the engine measures, and whose pose it makes, as in a batch of one."""

import numpy as np

from aerodft.dft import Request, Setup
from aerodft.dft import measure as measure_batch
from aerodft.model import Measurement, PoseBatch, PoseSample
from aerodft.service import LAST
from aerodft.service.pose import PoseSource


def measure(setup: Setup, sample: PoseSample, requests: tuple[Request, ...]) -> list[Measurement]:
    """What the requests come to."""
    return measure_batch(setup, PoseBatch.from_samples([sample]), tuple(requests))[0]


def sample_at(poses: PoseSource, stamp_ns: int, *, final: bool, by_utc: bool = False) -> PoseSample | None:
    """The pose at a stamp (UTC) as of the last tick; None as long as telemetry that matters may still come."""
    asked = np.array([stamp_ns]), LAST
    found, is_pending = poses.at(*asked, is_final=np.array([final]), by_utc=np.array([by_utc]))
    return None if is_pending[0] else found[0]
