"""What a vehicle may say of itself before its telemetry is not believed."""

from dataclasses import dataclass

from aerodft.conventions import SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthSettings:
    """Limits; what is beyond the first two has no answer, the others are remarked on.

    Attributes:
        heartbeat_ns: Longest silence of the autopilot's HEARTBEAT.
        max_ratio: Largest test ratio of the estimator: innovations over their gates, of which it refuses those above 1.
        gps_ns: Longest silence of the receiver.
        horizontal_std_m: Largest standard deviation of the receiver's position.
        vertical_std_m: Likewise.
        loss_share: Largest share of the autopilot's frames that may be lost.
        window_ns: Over which the share is counted.
    """

    heartbeat_ns: int = 5 * SECOND_NS
    max_ratio: float = 1.0
    gps_ns: int = 4 * SECOND_NS
    horizontal_std_m: float = 3.0
    vertical_std_m: float = 5.0
    loss_share: float = 0.1
    window_ns: int = 10 * SECOND_NS
