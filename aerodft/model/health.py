"""Health of a vehicle and of its link: as tracks, and as a summary at one stamp."""

from dataclasses import dataclass, field

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.telemetry import Track

RATIOS = ("velocity", "horizontal position", "vertical position", "compass")
"""Quantities of an EKF's test ratios: innovation over gate; the EKF rejects its inputs from 1 on."""

FIX_3D = 3
"""Lowest GPS_FIX_TYPE with a height."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeartbeatTrack(Track):
    """Heartbeats of the autopilot (HEARTBEAT).

    Attributes:
        autopilot: ``(n,)`` MAV_AUTOPILOT.
    """

    autopilot: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GpsTrack(Track):
    """The receiver's fixes and their accuracy (GPS_RAW_INT).

    Attributes:
        fix: ``(n,)`` GPS_FIX_TYPE: ``FIX_3D`` and more are three-dimensional.
        satellites: ``(n,)``, -1 where not known.
        horizontal_std_m: ``(n,)``, NaN where not known.
        vertical_std_m: ``(n,)``, NaN where not known.
    """

    fix: IntArray
    satellites: IntArray
    horizontal_std_m: FloatArray
    vertical_std_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimatorTrack(Track):
    """Status of the autopilot's EKF (EKF_STATUS_REPORT, ESTIMATOR_STATUS).

    Attributes:
        ratios: ``(n, 4)`` of ``RATIOS``.
        has_attitude: ``(n,)`` whether it has an attitude.
    """

    ratios: FloatArray
    has_attitude: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkTrack(Track):
    """Frames received from the autopilot, with gaps in their sequence numbers.

    Attributes:
        lost: ``(n,)`` frames missing right before each.
    """

    lost: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherSenderTrack(Track):
    """Messages of another sender that could have been followed as well, where the configuration names none.

    Attributes:
        what: Sentence: that sender, the one that is followed, and how to choose.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalFailureTrack(Track):
    """Failures reported by the followed gimbal (GIMBAL_DEVICE_ATTITUDE_STATUS).

    Attributes:
        what: What failed.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Health of a vehicle and its link at one stamp; None for what was never reported.

    Attributes:
        heartbeat_age_s: Since the autopilot's last HEARTBEAT, or since the link resumed after a silence.
        gps_fix: GPS_FIX_TYPE.
        gps_age_s: Since the report of the fix.
        satellites: Number of satellites.
        horizontal_std_m: Of the receiver's position.
        vertical_std_m: Of the receiver's altitude.
        ratios: The EKF's test ratios by quantity; empty where never reported.
        has_attitude: Whether the estimator has an attitude.
        received: Frames of the autopilot over the last seconds.
        lost: Frames missing between the received ones.
        ages_s: Age of the newest sample of each kind of telemetry, by its name.
    """

    heartbeat_age_s: float | None = None
    gps_fix: int | None = None
    gps_age_s: float | None = None
    satellites: int | None = None
    horizontal_std_m: float | None = None
    vertical_std_m: float | None = None
    ratios: dict[str, float] = field(default_factory=dict)
    has_attitude: bool | None = None
    received: int = 0
    lost: int = 0
    ages_s: dict[str, float] = field(default_factory=dict)

    @property
    def loss_share(self) -> float:
        """Fraction of the autopilot's frames that were lost."""
        return self.lost / (self.lost + self.received) if self.lost else 0.0
