"""What a live calibration says after it has looked at the landmarks of an image."""

from dataclasses import dataclass, field

from aerodft.model.pose import HeightSource


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasValues:
    """One number for each bias of the telemetry: an estimate (what is added to the telemetry), or a standard deviation.

    Attributes:
        height_m: Of the height source in use.
        east_m: Of the position.
        north_m: Likewise.
        tilt_rad: About the camera's x axis; raises the tilt.
        pan_rad: About its y axis.
        roll_rad: About its z axis.
        heading_rad: About the vertical, clockwise seen from above.
        time_s: Of images' stamps: the camera is where the telemetry says that it will be so much later.
    """

    height_m: float = 0.0
    east_m: float = 0.0
    north_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovation:
    """One observed landmark against where it was expected.

    Attributes:
        name: The landmark.
        px: Observed minus expected ``(u, v)``; None where nothing was expected.
        sigma_px: Standard deviation of each of the two, of everything that is not known.
        chi2: Their squared distance in standard deviations; of two degrees of freedom.
        reason: Why it was refused, one sentence; None where it was used.
    """

    name: str
    px: tuple[float, float] | None = None
    sigma_px: tuple[float, float] | None = None
    chi2: float | None = None
    reason: str | None = None

    @property
    def accepted(self) -> bool:
        """Whether the estimate follows it."""
        return self.reason is None


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEstimate:
    """The biases after one image's landmarks.

    Attributes:
        stamp_ns: The stamp of the image that they were seen in, UTC.
        calibration: What the next images' measurements name as their calibration.
        height_source: Whose height ``bias.height_m`` is added to; None where there was no pose.
        bias: The estimate.
        std: Its standard deviations.
        innovations: Of the landmarks of this image, the most credible first.
        updates: Landmarks used since the start.
        refused: Landmarks refused since the start.
        restarts: How often nearly everything was refused and the estimate began anew.
    """

    stamp_ns: int
    calibration: str | None
    height_source: HeightSource | None = None
    bias: BiasValues = field(default_factory=BiasValues)
    std: BiasValues = field(default_factory=BiasValues)
    innovations: tuple[Innovation, ...] = ()
    updates: int = 0
    refused: int = 0
    restarts: int = 0
