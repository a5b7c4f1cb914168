"""What a vehicle says of itself, and what is known of its link: as tracks, and as a summary at one stamp."""

from dataclasses import dataclass, field

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.telemetry import Track

RATIOS = ("velocity", "horizontal position", "vertical position", "compass")
"""What an estimator's test ratios are of: innovations over their gates, so that 1 is the most it accepts."""


FIX_3D = 3
"""The least GPS_FIX_TYPE that knows a height."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeartbeatTrack(Track):
    """The autopilot is alive (HEARTBEAT).

    Attributes:
        autopilot: ``(n,)`` MAV_AUTOPILOT.
    """

    autopilot: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GpsTrack(Track):
    """The receiver's fix, and how good it is (GPS_RAW_INT).

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
    """The autopilot's opinion of its own estimate (EKF_STATUS_REPORT, ESTIMATOR_STATUS).

    Attributes:
        ratios: ``(n, 4)`` of ``RATIOS``.
        has_attitude: ``(n,)`` whether it has an attitude.
    """

    ratios: FloatArray
    has_attitude: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkTrack(Track):
    """Every frame of the autopilot that came, by its sequence number.

    Attributes:
        lost: ``(n,)`` frames that are missing right before each.
    """

    lost: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RivalTrack(Track):
    """When somebody spoke who could have been followed as well, where nobody chose.

    Attributes:
        what: Who that is, who is followed and how to choose, in a sentence.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalFailureTrack(Track):
    """When the followed gimbal said that it fails (GIMBAL_DEVICE_ATTITUDE_STATUS).

    Attributes:
        what: What failed.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """What is known at one stamp; None for what was never said.

    Attributes:
        heartbeat_age_s: Since the autopilot's last HEARTBEAT, or since the link spoke again after a silence.
        gps_fix: GPS_FIX_TYPE.
        gps_age_s: Since it was said.
        satellites: Number of satellites.
        horizontal_std_m: Of the receiver's position.
        vertical_std_m: Of the receiver's altitude.
        ratios: The estimator's test ratios, by what they are of; empty where never said.
        has_attitude: Whether the estimator has an attitude.
        received: Frames of the autopilot over the last seconds.
        lost: Frames that are missing between these.
        ages_s: Since the newest of each kind of telemetry, by its name.
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
        """Share of the autopilot's frames that were lost."""
        return self.lost / (self.lost + self.received) if self.lost else 0.0
