"""Over many simulated flights, 95 % intervals and ellipses hold the truth as often as they say.

Every flight draws its own constant errors from the stds that the pipeline is told of, sends them as MAVLink through the
real decoder, and is measured once: one flight's measurements share their errors and would count as one.
"""

import os
from dataclasses import dataclass, replace

import numpy as np
import pytest

from aerodft.adapters.telemetry import CompositeDecoder
from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_yaw_pitch_roll, matrix, rays_from_pixels
from aerodft.model import (
    Ellipse95,
    HeightSource,
    Measurement,
    Observation,
    PixelSource,
    Pose,
    PoseStd,
    Probe,
    ProbeKind,
    RawBlock,
    ReportFrame,
    Status,
    WireProtocol,
)
from aerodft.service import (
    AttitudeSettings,
    Batches,
    HeightSettings,
    Pipeline,
    PipelineSettings,
    TelemetrySettings,
    block_of,
)
from aerodft.sim import Autopilot, datagrams, default_camera
from aerodft.sim.observations import pixels_of
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import draw_biases
from aerodft.sim.trajectory import Trajectory, camera_attitude_from_gimbal
from aerodft.sim.world import DEFAULT_ORIGIN
from tests.answers import answers_of, measurements_of

pytestmark = pytest.mark.nightly

FLIGHTS = 750 if os.environ.get("AERODFT_FAULTS") == "full" else 250
"""At each tilt. All 1,000 tell a coverage to 0.7 % (one std; 1.5 % are allowed): 92 % is seen 96 times in 100, and 87 %
at one tilt alone 99 times."""
CAMERA = default_camera(1920, 1080)
STD_PX = 1.0
MARGIN_PX = 50.0
TILTS_DEG = (0.0, 30.0, 45.0, 60.0)
LENGTH_S = 0.48
STAMP_NS = EPOCH_NS + round(0.22 * SECOND_NS)
CONSUMER = PoseStd(
    height_agl_m=1.0,
    horizontal_m=2.0,
    tilt_rad=np.radians(1.0),
    pan_rad=np.radians(1.0),
    roll_rad=np.radians(1.0),
    heading_rad=np.radians(2.0),
)
"""The defaults of a gimbal that only repeats its demands, and of a barometer."""
SURVEY = PoseStd(height_agl_m=0.1, horizontal_m=0.05, tilt_rad=1e-3, pan_rad=1e-3, roll_rad=1e-3, heading_rad=2e-3)
KINDS = (ProbeKind.POSITION, ProbeKind.RANGE, ProbeKind.DISTANCE)
PROBES = tuple(Probe(name=kind, kind=kind, source=PixelSource.OBSERVED) for kind in KINDS)
RATES_HZ = {"HEARTBEAT": 1.0, "SYSTEM_TIME": 2.0, "ATTITUDE": 10.0, "GLOBAL_POSITION_INT": 10.0}
RATES_HZ |= {"GIMBAL_DEVICE_ATTITUDE_STATUS": 10.0}


@dataclass(frozen=True)
class Motion:
    """How fast things go: the vehicle (m/s), its heading and the gimbal's pitch (deg/s)."""

    speed_mps: float = 0.0
    turn_dps: float = 0.0
    pitch_dps: float = 0.0


@dataclass
class Score:
    """How one kind of measurement did."""

    inside: list[bool]
    refused: int = 0


def _trajectory(draw: np.random.Generator, tilt_deg: float, motion: Motion) -> Trajectory:
    """A flight of a moment: random place, heading, lean and gimbal yaw and roll, motion in random directions."""
    elapsed_s = np.arange(0.0, LENGTH_S + 0.01, 0.04)
    course, signs = draw.uniform(0, 2 * np.pi), draw.choice([-1.0, 1.0], 2)
    velocity = motion.speed_mps * np.array([np.sin(course), np.cos(course), 0.0])
    start = np.append(draw.uniform(-100, 100, 2), draw.uniform(25, 60))
    heading = draw.uniform(0, 2 * np.pi) + np.radians(signs[0] * motion.turn_dps) * elapsed_s
    pitch = np.radians(tilt_deg - 90 + draw.uniform(-3, 3) + signs[1] * motion.pitch_dps * (elapsed_s - LENGTH_S / 2))
    lean = np.radians(draw.uniform(-10, 10, 2))
    body = from_yaw_pitch_roll(heading, lean[0], lean[1])
    gimbal = from_yaw_pitch_roll(np.radians(draw.uniform(-30, 30)), pitch, np.radians(draw.uniform(-5, 5)))
    return Trajectory(
        origin=DEFAULT_ORIGIN,
        stamp_ns=EPOCH_NS + np.round(elapsed_s * SECOND_NS).astype(np.int64),
        position_enu_m=start + elapsed_s[:, None] * velocity,
        ned_wxyz_body=body,
        level_wxyz_gimbal=gimbal,
        enu_wxyz_cam=camera_attitude_from_gimbal(body, gimbal),
    )


def _telemetry(draw: np.random.Generator, truth: Trajectory, std: PoseStd) -> RawBlock:
    """What the autopilot says of the flight, wrong by what one flight draws."""
    shift = np.append(draw.standard_normal(2) * std.horizontal_m, 0.0)
    biases = draw_biases(std, int(draw.integers(2**31)))
    told = replace(truth, position_enu_m=truth.position_enu_m + shift)
    sent = datagrams(told, Autopilot(rates_hz=RATES_HZ, biases=biases))
    return block_of(WireProtocol.MAVLINK, "sim", [each.due_ns for each in sent], [each.data for each in sent])


def _visible_points(draw: np.random.Generator, pose: Pose) -> np.ndarray:
    """Two ground points, ``(2, 3)``, whose pixels are spread over the image."""
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    rays = rays_from_pixels(CAMERA, draw.uniform(MARGIN_PX, size - MARGIN_PX, (2, 2))) @ matrix(pose.wxyz).T
    return (pose.position_enu_m - rays * (pose.position_enu_m[2] / rays[:, 2:])) * [1, 1, 0]


def _settings(std: PoseStd) -> PipelineSettings:
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
    )


def _flight(
    draw: np.random.Generator, tilt_deg: float, std: PoseStd, motion: Motion
) -> tuple[Pose, np.ndarray, list[Measurement]]:
    """One flight: the camera's true pose, the true points ``(2, 3)``, and what was measured."""
    truth = _trajectory(draw, tilt_deg, motion)
    raw = _telemetry(draw, truth, std)
    late_ns = round(draw.standard_normal() * std.time_s * SECOND_NS)
    pose = truth.pose(STAMP_NS)
    points = _visible_points(draw, pose)
    pixels = pixels_of(CAMERA, pose, points) + draw.normal(0, STD_PX, (2, 2))
    seen = tuple(
        Observation(
            name=probe.name,
            stamp_ns=STAMP_NS + late_ns,
            arrival_ns=truth.end_ns,
            pixels=tuple(map(tuple, pixels[: 2 if probe.kind == ProbeKind.DISTANCE else 1].tolist())),
            std_px=STD_PX,
        )
        for probe in PROBES
    )
    pipeline = Pipeline(_settings(std), CompositeDecoder())
    batches = Batches.from_events(np.array([truth.end_ns]), [raw, *seen])
    return pose, points, measurements_of(answers_of(pipeline, [batches]))


def _is_inside(measured: Measurement, pose: Pose, points: np.ndarray) -> bool:
    if measured.kind == ProbeKind.POSITION:
        return _in_ellipse(measured.ellipse95, points[0, :2] - measured.enu_m[0][:2])
    ends = (points[0], points[1] if measured.kind == ProbeKind.DISTANCE else pose.position_enu_m)
    low, high = measured.ci95
    return bool(low <= np.linalg.norm(ends[1] - ends[0]) <= high)


def _in_ellipse(ellipse: Ellipse95, off_en_m: np.ndarray) -> bool:
    along = np.array([np.sin(ellipse.azimuth_rad), np.cos(ellipse.azimuth_rad)])
    across = np.array([along[1], -along[0]])
    return bool(np.hypot(off_en_m @ along / ellipse.semi_major_m, off_en_m @ across / ellipse.semi_minor_m) <= 1)


def _scores(tilt_deg: float, std: PoseStd, motion: Motion, seed: int) -> dict[ProbeKind, Score]:
    draw = np.random.default_rng([seed, round(tilt_deg)])
    scores = {kind: Score([]) for kind in KINDS}
    for _ in range(FLIGHTS):
        pose, points, measured = _flight(draw, tilt_deg, std, motion)
        assert [each.kind for each in measured] == list(KINDS)
        for each in measured:
            if each.status is Status.ILL_CONDITIONED:
                scores[each.kind].refused += 1
            else:
                assert each.status is Status.OK
                scores[each.kind].inside.append(_is_inside(each, pose, points))
    return scores


CASES = {
    "consumer gimbal, barometer": (CONSUMER, Motion(), 1),
    "survey gimbal, RTK": (SURVEY, Motion(), 2),
    "image stamps off, moving": (replace(SURVEY, time_s=0.05), Motion(speed_mps=10, turn_dps=20, pitch_dps=10), 3),
}


@pytest.mark.parametrize("name", CASES)
def test_95_percent_intervals_hold_the_truth_in_95_percent_of_the_flights(name):
    rows = {tilt_deg: _scores(tilt_deg, *CASES[name]) for tilt_deg in TILTS_DEG}
    print(f"\n{name}: share of {FLIGHTS} flights inside the 95 % interval or ellipse (refused as ill-conditioned)")
    print(f"{'tilt':>6}" + "".join(f"{kind:>18}" for kind in KINDS))
    for tilt_deg, scores in rows.items():
        cells = (f"{np.mean(score.inside):.1%} ({score.refused})" for score in scores.values())
        print(f"{tilt_deg:6g}" + "".join(f"{cell:>18}" for cell in cells))
    for kind in KINDS:
        for tilt_deg, scores in rows.items():
            assert scores[kind].refused < 0.1 * FLIGHTS, (tilt_deg, kind)
            assert 0.92 <= np.mean(scores[kind].inside) <= 0.98, (tilt_deg, kind)
        assert 0.935 <= np.mean([each for scores in rows.values() for each in scores[kind].inside]) <= 0.965, kind
