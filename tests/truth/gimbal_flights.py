"""Random flights of a vehicle with a gimbal, as decoded telemetry, with the camera's true attitude.

The vehicle accelerates, brakes and is shaken by gusts; the gimbal is commanded about once in ten seconds, and its
reports are against the horizon or against the vehicle, late, noisy, and rounded as the message rounds them.
"""

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from aerodft.geometry import yaw_pitch_roll
from aerodft.model import (
    NO_BOOT_TIME,
    ClockTrack,
    GimbalSource,
    GimbalTrack,
    MountAxes,
    PositionTrack,
    ReportFrame,
    VehicleTrack,
)

STEP_NS = 10_000_000
UTC0_NS = 1_795_221_168_000_000_000
BOOT0_NS = 60_000_000_000
CENTIDEG = np.radians(0.01)
MESSAGES = (GimbalSource.GIMBAL_DEVICE, GimbalSource.MOUNT_ORIENTATION, GimbalSource.MOUNT_STATUS)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What kind of flight.

    Attributes:
        seed: Of all chances.
        frame: What the reports are against.
        axes: Which servo of the mount carries the other, if they are against the vehicle.
        message: Which message brings them.
        yaw_in_earth: Whether their yaw is against north.
        lag_s: How much later than the vehicle's attitude the same instant's report comes.
        noise_deg: Of every report, about each axis; 0 for demands.
        vehicle_noise_deg: Of every attitude of the vehicle, about each axis.
        seconds: How long.
        rate_hz: Of both streams.
        gust_deg: Standard deviation of the vehicle's tilt in a hover.
        lean_deg: How far it leans to move.
        limits_deg: Pitches against the body that a servo reaches.
    """

    seed: int
    frame: ReportFrame
    axes: MountAxes = MountAxes.TILT_OUTER
    message: GimbalSource = GimbalSource.GIMBAL_DEVICE
    yaw_in_earth: bool = False
    lag_s: float = 0.0
    noise_deg: float = 0.0
    vehicle_noise_deg: float = 0.0
    seconds: float = 120.0
    rate_hz: float = 10.0
    gust_deg: float = 1.0
    lean_deg: float = 15.0
    limits_deg: tuple[float, float] = (-180.0, 180.0)


@dataclass(frozen=True, kw_only=True)
class Flight:
    """Telemetry and truth of one flight.

    Attributes:
        tracks: Each in the order in which it came; the gimbal's last.
        looking: ``ned_SO3_gimbal`` every ``STEP_NS`` from ``UTC0_NS``.
    """

    tracks: tuple
    looking: Rotation

    def looking_at(self, stamp_ns):
        """The true ``ned_SO3_gimbal``."""
        grid_ns = np.arange(len(self.looking)) * STEP_NS
        return Slerp(grid_ns, self.looking)(stamp_ns - UTC0_NS)

    def parts(self, *, seconds):
        """The tracks in slices of arrival time, as a station gets them."""
        end_ns = max(int(track.arrival_ns[-1]) for track in self.tracks)
        edges = range(UTC0_NS, end_ns + round(seconds * 1e9) + 1, round(seconds * 1e9))
        for start, stop in pairwise(edges):
            yield tuple(_rows(track, *np.searchsorted(track.arrival_ns, [start, stop])) for track in self.tracks)


def _rows(track, start, stop):
    arrays = {f.name: getattr(track, f.name) for f in fields(track)}
    return type(track)(**{k: v[start:stop] if isinstance(v, np.ndarray) else v for k, v in arrays.items()})


def exchanged(one, two):
    """A flight with the gimbal of one until its middle, and twelve seconds later of another; both held the same."""
    rows, samples = len(one.tracks[-1].arrival_ns) // 2, len(one.looking) // 2
    before, after = _rows(one.tracks[-1], 0, rows), _rows(two.tracks[-1], rows + 120, None)
    names = [each.name for each in fields(before) if isinstance(getattr(before, each.name), np.ndarray)]
    gimbals = {name: np.concatenate([getattr(before, name), getattr(after, name)]) for name in names}
    return Flight(
        tracks=(*one.tracks[:-1], replace(before, **gimbals)),
        looking=Rotation.concatenate([one.looking[:samples], two.looking[samples:]]),
    )


def made(plan):
    """A flight."""
    generator = np.random.default_rng(plan.seed)
    count = round(plan.seconds * 1e9 / STEP_NS) + 1
    heading = _smooth(_steps(generator, count, 8.0, lambda: generator.uniform(-90, 90), relative=True), 0.8)
    lean = [_smooth(_steps(generator, count, 6.0, lambda: plan.lean_deg * generator.uniform(-1, 1)), 0.4) for _ in "pr"]
    gust = [_smooth(generator.standard_normal(count), 0.5) for _ in "pr"]
    pitch, roll = (each + plan.gust_deg * shake / np.std(shake) for each, shake in zip(lean, gust, strict=True))
    vehicle = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]), degrees=True)
    pan = _smooth(_steps(generator, count, 12.0, lambda: generator.choice([0, 0, -40, 40])), 0.1)
    down = _smooth(_steps(generator, count, 10.0, lambda: generator.choice([0, -30, -45, -60, -90])), 0.1)
    level = Rotation.from_euler("Z", heading[:, None], degrees=True)
    wanted = level * Rotation.from_euler("ZYX", np.column_stack([pan, down, 0 * pan]), degrees=True)
    if plan.frame is ReportFrame.EARTH:
        looking = wanted
        packed = level.inv() * wanted
    else:
        order: Literal["ZYX", "ZXY"] = "ZYX" if plan.axes is MountAxes.TILT_OUTER else "ZXY"
        pitch_at = order.index("Y")
        joints = (vehicle.inv() * wanted).as_euler(order, degrees=True)
        joints[:, pitch_at] = np.clip(joints[:, pitch_at], *plan.limits_deg)
        looking = vehicle * Rotation.from_euler(order, joints, degrees=True)
        if plan.axes is MountAxes.ROLL_OUTER:  # a servo's noise is that of its angle
            joints += plan.noise_deg * generator.standard_normal(joints.shape)
        packed = Rotation.from_euler("ZYX", joints[:, [0, pitch_at, 3 - pitch_at]], degrees=True)
    return Flight(tracks=_tracks(plan, generator, vehicle, packed), looking=looking)


def _tracks(plan, generator, vehicle, packed):
    period = round(1e9 / plan.rate_hz / STEP_NS)
    rows = np.arange(0, len(vehicle), period)
    boot = BOOT0_NS + rows * STEP_NS
    arrival = UTC0_NS + rows * STEP_NS + 20_000_000
    noise_rad = 0.0 if plan.axes is MountAxes.ROLL_OUTER else np.radians(plan.noise_deg)
    noise = Rotation.from_rotvec(noise_rad * generator.standard_normal((len(rows), 3)))
    late = np.maximum(rows - round(plan.lag_s * 1e9 / STEP_NS), 0)
    report = packed[late] * noise
    if plan.yaw_in_earth:
        report = Rotation.from_euler("Z", vehicle[late].as_euler("ZYX")[:, :1]) * report
    if plan.message is GimbalSource.MOUNT_STATUS:
        angles = np.stack(yaw_pitch_roll(report.as_quat(scalar_first=True)), axis=-1)
        report = Rotation.from_euler("ZYX", np.rint(angles / CENTIDEG) * CENTIDEG)
    unstamped = np.full(len(rows), NO_BOOT_TIME)
    stamps = {"arrival_ns": arrival, "boot_ns": boot}
    gimbal = GimbalTrack(
        arrival_ns=arrival + 2_000_000,
        boot_ns=unstamped if plan.message is GimbalSource.MOUNT_STATUS else boot + 2_000_000,
        source=plan.message,
        wxyz=report.as_quat(scalar_first=True),
        yaw_in_earth=np.full(len(rows), plan.yaw_in_earth),
    )
    level = np.zeros(len(rows))
    shaken = Rotation.from_rotvec(np.radians(plan.vehicle_noise_deg) * generator.standard_normal((len(rows), 3)))
    return (
        ClockTrack(**stamps, unix_ns=UTC0_NS + rows * STEP_NS),
        VehicleTrack(**stamps, wxyz=(vehicle[rows] * shaken).as_quat(scalar_first=True)),
        PositionTrack(
            **stamps, lat_rad=level + 0.8, lon_rad=level + 0.1, alt_msl_m=level + 460, height_home_m=level + 50
        ),
        gimbal,
    )


def _steps(generator, count, mean_s, draw, *, relative=False):
    """A value that changes at random times."""
    changes = generator.random(count) < STEP_NS / 1e9 / mean_s
    drawn = np.array([draw() for _ in range(int(changes.sum()) + 1)], dtype=float)
    values = drawn[np.cumsum(changes)]
    return np.cumsum(drawn)[np.cumsum(changes)] if relative else values


def _smooth(values, seconds):
    return gaussian_filter1d(values, seconds * 1e9 / STEP_NS, mode="nearest")
