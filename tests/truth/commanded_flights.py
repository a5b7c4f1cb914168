"""Flights of a real autopilot over a simulated vehicle, and the angles that their cameras were commanded to hold."""

import json
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.geometry import camera_from_gimbal, from_yaw_pitch_roll, inverse, matrix, multiply, to_rotation_vector
from aerodft.model import HeightSource, PoseStd, RawBlock, Track
from aerodft.service import LAST, AttitudeSettings, HeightSettings, TelemetrySettings
from aerodft.service.clocks import Ticks
from aerodft.service.pose import PoseSource

SITL = Path(__file__).parents[2].parent / "shared" / "data" / "sitl"
SAMPLE = Path(__file__).parent / "flights"  # a minute of servo_wind.tlog, every second sample

DEG = math.radians(1)
STD = PoseStd(tilt_rad=DEG, pan_rad=DEG, roll_rad=DEG, heading_rad=2 * DEG)
SETTLED_S, SHORT_S, EVERY_S = 3.0, 1.0, 0.25  # after a command; before the next; between two looks
TURNING = {"leg 2 s", "leg 4 s", "leg 24 s"}
STEP_NS = 10**9  # what arrives within it is taken in together


@dataclass(frozen=True, kw_only=True)
class Held:
    """What a camera held: angles against the horizon and the vehicle's true heading, without roll.

    Attributes:
        what: The command in words.
        times_s: ``(n,)`` since boot, or UTC.
        pitch_rad: One number.
        heading_rad: ``(n,)`` from north.
    """

    what: str
    times_s: np.ndarray
    pitch_rad: float
    heading_rad: np.ndarray

    def enu_wxyz_cam(self):
        """``(n, 4)``."""
        return camera_from_gimbal(from_yaw_pitch_roll(self.heading_rad, self.pitch_rad, 0.0))


def held(folder, control):
    """What was held, and whether its times are since boot."""
    document = json.loads((folder / control).read_text())
    by_boot = "samples" in document
    return [each for each in (_events if by_boot else _commands)(document) if len(each.times_s)], by_boot


def _events(document):
    """Of the flights whose pilot looked at the vehicle right before every next command."""
    pitch, yaw, is_locked = 0.0, 0.0, False
    for sample in document["samples"]:
        tag, boot_s = sample["tag"], sample["SYSTEM_TIME"]["time_boot_ms"] / 1e3
        if tag.startswith("gimbal cmd"):
            words = tag.split()
            pitch, yaw, is_locked = float(words[3]), float(words[5]), words[7] == "True"
        elif not tag.startswith(("heading", "leg")) or tag in {
            "leg 2 s",
            "leg 4 s",
            "leg 24 s",
        }:  # the vehicle turns then
            continue
        times_s = np.arange(boot_s - SHORT_S, boot_s, EVERY_S)
        heading = np.full(len(times_s), (0.0 if is_locked else sample["veh_rpy"][2]) + yaw)
        yield Held(what=tag, times_s=times_s, pitch_rad=pitch * DEG, heading_rad=heading * DEG)


def _commands(document):
    """Of the flight that was flown from a list of commands."""
    state = document["sim_state"]
    at_s, yaws = [each["utc_s"] for each in state], np.unwrap([each["yaw"] for each in state])
    commands = [each for each in document["commands"] if each["command"].startswith("gim ")]
    stops = [each["utc_s"] for each in document["commands"] if each["command"].startswith(("gim ", "param MNT1_TYPE"))]
    for command in commands:
        pitch, yaw = (float(word) * DEG for word in command["command"].split()[1:3])
        until_s = min((stop for stop in stops if stop > command["utc_s"]), default=at_s[-1])
        times_s = np.arange(command["utc_s"] + SETTLED_S, until_s - SHORT_S, EVERY_S)
        around_s = times_s[:, None, None] + [[-2.0], [2.0]]
        times_s = times_s[np.abs(around_s - at_s).min(axis=2).max(axis=1) < SHORT_S]  # a sample has gaps
        what = f"{command['command']} at {command['utc_s'] % 1000:.0f} s"
        yield Held(what=what, times_s=times_s, pitch_rad=pitch, heading_rad=np.interp(times_s, at_s, yaws) + yaw)


@dataclass(frozen=True, kw_only=True)
class Found:
    """Attitudes against what was held.

    Attributes:
        held: What was.
        errors_rad: ``(n, 3)`` about the camera's axes; NaN without a pose.
        stds_rad: ``(n, 3)`` stated, the heading's included.
        reasons: By row.
    """

    held: Held
    errors_rad: np.ndarray
    stds_rad: np.ndarray
    reasons: tuple


def flown(path, held, *, by_boot, **attitude):
    """Attitudes at all times that something was held, each as soon as its telemetry is there."""
    settings = TelemetrySettings(
        height=HeightSettings(order=(HeightSource.HOME,), min_m=-10.0), attitude=AttitudeSettings(std=STD, **attitude)
    )
    source, decoder = PoseSource(settings, origin=None, time_std_s=0.0), CompositeDecoder(None)
    waiting_s = np.concatenate([each.times_s for each in held])
    samples = []
    for block in (event for event in open_log(path).events() if isinstance(event, RawBlock)):
        edges = np.flatnonzero(np.diff(block.arrival_ns // STEP_NS)) + 1
        for start, stop in pairwise([0, *edges.tolist(), len(block.offset)]):
            source.append(Ticks.one(decoder.decode(block.rows(slice(start, stop)))))
            if not source.clock.is_utc_known:
                continue
            newest_ns = int(source.watermark_ns(1)[0])
            stamps_ns = _utc_ns(source.clock, waiting_s, by_boot=by_boot)
            ready = int(np.searchsorted(stamps_ns, newest_ns - 10**9))
            samples += _looks(source, stamps_ns[:ready])
            waiting_s = waiting_s[ready:]
    ends = np.cumsum([0, *(len(each.times_s) for each in held)])
    return [
        _found(each, samples[start:stop])
        for each, start, stop in zip(held, ends, ends[1:], strict=False)
        if stop <= len(samples)
    ]


def _utc_ns(clock, times_s, *, by_boot):
    stamps_ns = np.round(times_s * 1e9).astype(np.int64)
    if not by_boot:
        return stamps_ns
    return clock.to_utc(Track(arrival_ns=np.zeros_like(stamps_ns), boot_ns=stamps_ns), LAST)


def _looks(source, stamps_ns):
    if not len(stamps_ns):
        return []
    last, yes = np.full(len(stamps_ns), -1), np.ones(len(stamps_ns), dtype=bool)
    poses, _ = source.at(stamps_ns, last, is_final=yes, by_utc=yes)
    return [poses[row] for row in range(len(stamps_ns))]


def _found(held, samples):
    errors, stds = np.full((2, len(samples), 3), np.nan)
    for row, (sample, truth) in enumerate(zip(samples, held.enu_wxyz_cam(), strict=True)):
        if sample.pose is None:
            continue
        errors[row] = to_rotation_vector(multiply(inverse(sample.pose.wxyz), truth))
        up, std = matrix(sample.pose.wxyz)[2], sample.std
        stds[row] = np.hypot([std.tilt_rad, std.pan_rad, std.roll_rad], np.abs(up) * std.heading_rad)
    return Found(held=held, errors_rad=errors, stds_rad=stds, reasons=tuple(sample.reasons for sample in samples))
