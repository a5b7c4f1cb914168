"""Simulated flights over surveyed markers, as MAVLink and observed pixels, with known truth."""

from dataclasses import dataclass, field, replace

import numpy as np

from aerodft.adapters.telemetry import CompositeDecoder
from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_yaw_pitch_roll, matrix, rays_from_pixels
from aerodft.model import (
    BiasValues,
    CalibrationEstimate,
    HeightSource,
    Measurement,
    Observation,
    PixelSource,
    PoseStd,
    Probe,
    ProbeKind,
    ReportFrame,
    SurveyedLandmark,
    WireProtocol,
)
from aerodft.service import (
    AttitudeSettings,
    Batches,
    HeightSettings,
    LiveCalibration,
    Pipeline,
    PipelineSettings,
    TelemetrySettings,
    block_of,
)
from aerodft.sim import Autopilot, datagrams, default_camera
from aerodft.sim.observations import pixels_of
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.trajectory import Trajectory, camera_attitude_from_gimbal
from aerodft.sim.world import DEFAULT_ORIGIN
from calibration.live import LiveCalibrator
from tests.answers import ImageAnswer, ObservationAnswer, answers_of

CAMERA = default_camera(1920, 1080)
SIZE = np.array([CAMERA.width_px, CAMERA.height_px])
CONSUMER = PoseStd(
    height_agl_m=1.0,
    horizontal_m=2.0,
    tilt_rad=np.radians(1.0),
    pan_rad=np.radians(1.0),
    roll_rad=np.radians(1.0),
    heading_rad=np.radians(2.0),
)
"""The defaults of a gimbal that only repeats its demands, and of a barometer."""
MARGIN_PX = 60.0
MARKERS = ("marker-1", "marker-2", "marker-3")
KINDS = (ProbeKind.POSITION, ProbeKind.RANGE, ProbeKind.DISTANCE)
PROBES = tuple(Probe(name=kind, kind=kind, source=PixelSource.OBSERVED) for kind in KINDS)
IMAGES_HZ = 4
RIVER = np.array([[0.2, 0.5], [0.8, 0.6]])
"""Where the banks are in a flight's last image, as shares of its size, when they are measured in every image."""
RATES_HZ = {"HEARTBEAT": 1.0, "SYSTEM_TIME": 1.0, "ATTITUDE": 2.0, "GLOBAL_POSITION_INT": IMAGES_HZ}
RATES_HZ |= {"GIMBAL_DEVICE_ATTITUDE_STATUS": IMAGES_HZ}
SAMPLED_NS = 3_000_000
"""Positions are sampled this long after a whole period, and so are images: interpolation would average noise away."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What the observers of a flight do.

    Attributes:
        markers: How many of the three markers are seen.
        std_px: Of every coordinate.
        survey_std_m: Of every component of a marker's place.
        strays: Share of markers' observations that are 20 to 80 px off.
    """

    markers: int = 3
    std_px: float = 1.0
    survey_std_m: float = 0.0
    strays: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What the telemetry of a flight says minus what is true.

    Attributes:
        biases: Constant ones of height and attitude.
        shift_m: Of east and north.
        noise_share: What is new in every sample, as a share of the stated stds.
    """

    biases: BiasValues
    shift_m: np.ndarray = field(default_factory=lambda: np.zeros(2))
    noise_share: float = 0.1


@dataclass(frozen=True)
class Flight:
    """A flight that is over: true ground points ``(2, 3)``, the true last position, and what came out.

    ``measured`` holds the measurements of every image by its stamp.
    """

    truth: Trajectory
    points: np.ndarray
    measured: dict[int, list[Measurement]] = field(default_factory=dict)
    estimates: list[CalibrationEstimate] = field(default_factory=list)

    @property
    def last(self):
        return self.measured[max(self.measured)]

    @property
    def width_m(self):
        return float(np.linalg.norm(self.points[1] - self.points[0]))

    def width_errors(self):
        """Relative errors of the widths, in order of the images; NaN where a bank is outside."""
        widths = [each for stamp in sorted(self.measured) for each in self.measured[stamp] if each.name == "distance"]
        return np.array([np.nan if each.value is None else each.value / self.width_m - 1 for each in widths])


def drawn(draw, std, share=0.1):
    """One flight's errors, as the stated stds have them."""
    kept = np.sqrt(1 - share**2)
    height, tilt, pan, roll, heading = (kept * draw.standard_normal(5)).tolist()
    biases = BiasValues(
        height_m=height * std.height_agl_m,
        tilt_rad=tilt * std.tilt_rad,
        pan_rad=pan * std.pan_rad,
        roll_rad=roll * std.roll_rad,
        heading_rad=heading * std.heading_rad,
    )
    return Errors(biases=biases, shift_m=kept * draw.standard_normal(2) * std.horizontal_m, noise_share=share)


def noise_of(std, share):
    return PoseStd(
        height_agl_m=share * std.height_agl_m,
        horizontal_m=share * std.horizontal_m,
        tilt_rad=share * std.tilt_rad,
        pan_rad=share * std.pan_rad,
        roll_rad=share * std.roll_rad,
        heading_rad=share * std.heading_rad,
    )


def trajectory(draw, tilt_deg, *, height_m=None, length_s=6.0, speed_mps=1.0, turn_dps=3.0):
    """A slow flight in a random direction with a random heading, lean and gimbal."""
    elapsed_s = np.arange(0.0, length_s + 0.01, 0.1)
    course = draw.uniform(0, 2 * np.pi)
    velocity = speed_mps * np.array([np.sin(course), np.cos(course), 0.0])
    up_m = draw.uniform(25, 60) if height_m is None else height_m
    start = np.append(draw.uniform(-100, 100, 2), up_m)
    turned = np.radians(draw.choice([-1.0, 1.0]) * turn_dps) * (elapsed_s - length_s / 2)
    lean = np.radians(draw.uniform(-10, 10, 2))
    body = from_yaw_pitch_roll(draw.uniform(0, 2 * np.pi) + turned, lean[0], lean[1])
    pitch = np.radians(np.full_like(elapsed_s, tilt_deg - 90 + draw.uniform(-3, 3)))
    gimbal = from_yaw_pitch_roll(np.radians(draw.uniform(-30, 30)), pitch, np.radians(draw.uniform(-5, 5)))
    return Trajectory(
        origin=DEFAULT_ORIGIN,
        stamp_ns=EPOCH_NS + np.round(elapsed_s * SECOND_NS).astype(np.int64),
        position_enu_m=start + elapsed_s[:, None] * velocity,
        ned_wxyz_body=body,
        level_wxyz_gimbal=gimbal,
        enu_wxyz_cam=camera_attitude_from_gimbal(body, gimbal),
    )


def on_ground(pose, pixels):
    """Ground points ``(n, 3)`` that a camera sees at ``pixels (n, 2)``."""
    rays = rays_from_pixels(CAMERA, pixels) @ matrix(pose.wxyz).T
    return (pose.position_enu_m - rays * (pose.position_enu_m[2] / rays[:, 2:])) * [1, 1, 0]


def settings(std, **rest):
    height = HeightSettings(order=(HeightSource.HOME,), std_m={HeightSource.HOME: std.height_agl_m})
    telemetry = TelemetrySettings(
        height=height, attitude=AttitudeSettings(std=std, frame=ReportFrame.EARTH, is_demand=False)
    )
    return PipelineSettings(
        station="coverage",
        camera=CAMERA,
        probes=PROBES,
        telemetry=telemetry,
        origin=DEFAULT_ORIGIN,
        time_std_s=std.time_s,
        **rest,
    )


def observation(name, stamp_ns, pixels, std_px):
    pixels = np.reshape(pixels, (-1, 2))
    return Observation(
        name=name, stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=tuple(map(tuple, pixels.tolist())), std_px=std_px
    )


def in_view(pixels):
    return bool(np.all((pixels >= MARGIN_PX / 2) & (pixels <= SIZE - MARGIN_PX / 2)))


def markers_of(draw, truth, points_px=None):
    """Three markers that are seen in the middle of the flight, spread over the image, ``(3, 3)``."""
    pose = truth.pose((truth.start_ns + truth.end_ns) // 2)
    pixels = draw.uniform(0.2, 0.8, (3, 2)) * SIZE if points_px is None else points_px
    return on_ground(pose, pixels)


def flown(draw, truth, std, seen, errors, *, every_width=False):
    """Send a flight through the pipeline, and measure in its last image, or in every one."""
    told = replace(truth, position_enu_m=truth.position_enu_m + np.append(errors.shift_m, 0.0))
    noise = noise_of(std, errors.noise_share)
    autopilot = Autopilot(rates_hz=RATES_HZ, biases=errors.biases, noise=noise, seed=int(draw.integers(2**31)))
    sent = datagrams(told, autopilot)
    raw = block_of(WireProtocol.MAVLINK, "sim", [each.due_ns for each in sent], [each.data for each in sent])
    places = markers_of(draw, truth)
    surveyed = places + seen.survey_std_m * draw.standard_normal(places.shape)
    landmarks = tuple(
        SurveyedLandmark(name=name, position_enu_m=tuple(place), std_m=(seen.survey_std_m,) * 3)
        for name, place in zip(MARKERS, surveyed.tolist(), strict=True)
    )
    calibrator = LiveCalibrator(LiveCalibration(landmarks=landmarks), settings(std))
    pipeline = Pipeline(settings(std), CompositeDecoder(), calibrator, calibrator)
    step_ns = SECOND_NS // IMAGES_HZ
    stamps = range(truth.start_ns + step_ns + SAMPLED_NS, truth.end_ns - step_ns, step_ns)
    last = truth.pose(stamps[-1])
    points = on_ground(last, RIVER * SIZE if every_width else draw.uniform(MARGIN_PX, SIZE - MARGIN_PX, (2, 2)))
    observations = _observations(draw, truth, seen, stamps, places, points, every_width=every_width)
    end_ns = max(truth.end_ns, *(each.due_ns for each in sent))
    batches = Batches.from_events(np.array([end_ns]), [raw, *observations])
    return _seen(Flight(truth, points), answers_of(pipeline, [batches]))


def _observations(draw, truth, seen, stamps, places, points, *, every_width):
    """What is seen at some stamps: the markers, and in the last image (or in every one) the points to measure."""
    observations = []
    for stamp in stamps:
        pose = truth.pose(stamp)
        for name, place in list(zip(MARKERS, places, strict=True))[: seen.markers]:
            pixel = pixels_of(CAMERA, pose, place)
            if not in_view(pixel):
                continue
            pixel = pixel + draw.normal(0, seen.std_px, 2)
            if draw.random() < seen.strays:
                away = draw.uniform(0, 2 * np.pi)
                pixel = pixel + draw.uniform(20, 80) * np.array([np.cos(away), np.sin(away)])
            observations.append(observation(name, stamp, pixel, seen.std_px))
        if every_width or stamp == stamps[-1]:
            pixels = pixels_of(CAMERA, pose, points) + draw.normal(0, seen.std_px, (2, 2))
            for probe in PROBES:
                count = 2 if probe.kind == ProbeKind.DISTANCE else 1
                observations.append(observation(probe.name, stamp, pixels[:count], seen.std_px))
    return observations


def _seen(flight, answers):
    """The flight with what came out of it."""
    for answer in answers:
        if isinstance(answer, ImageAnswer | ObservationAnswer):
            for each in answer.measurements:
                flight.measured.setdefault(each.stamp_ns, []).append(each)
        elif isinstance(answer, CalibrationEstimate):
            flight.estimates.append(answer)
    return flight
