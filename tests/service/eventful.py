"""Flights in which something happens all the time, as real MAVLink bytes, images and observations."""

import math
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.model import HeightSource, PixelSource, Probe, ProbeKind, StampClock, WireProtocol
from aerodft.service import OBJECTS, HeightSettings, ZoomSettings, block_of

MS = 1_000_000
AUTOPILOT, CAMERA, RIVAL = (1, 1), (1, 100), (2, 1)  # system and component
SECONDS = 40
MARK = Probe(name="mark-p", kind=ProbeKind.POSITION, source=PixelSource.OBSERVED)


@dataclass(frozen=True, kw_only=True)
class Happenings:
    """When something happens in a flight, in seconds since its start.

    Attributes:
        jump_s: By how much the vehicle's UTC jumps 12 s into the flight; 0 for not at all.
        reboots: Whether the vehicle reboots after 24 s, and is silent for 2 s then.
        has_companion: Whether the camera, and a rival, speak from another address than the autopilot.
        is_utc_late: Whether the vehicle says UTC after 3 s only.
        late_s: From when to when all telemetry comes 0.3 s later than else, each time.
        seed: Of the link's delays, of what is lost, and of when what is seen comes.
    """

    jump_s: float = 0.0
    reboots: bool = False
    has_companion: bool = False
    is_utc_late: bool = False
    late_s: tuple[tuple[float, float], ...] = ()
    seed: int = 1


def settings_of(bench):
    """Every source of a height, a zoom, a landmark that is a probe, a short wait, and health by the usual rules."""
    telemetry = replace(
        bench.settings.telemetry,
        height=HeightSettings(order=(HeightSource.RANGEFINDER, HeightSource.TERRAIN, HeightSource.HOME)),
        zoom=ZoomSettings(curve=((0.0, 1.0), (1.0, 6.0))),
        wait_ns=1_200 * MS,
    )
    return replace(bench.settings, telemetry=telemetry, probes=(*bench.settings.probes, MARK))


def events_of(bench, happenings):
    """Blocks, images and observations in no order."""
    rng = np.random.default_rng(happenings.seed)
    return [*_blocks(bench, happenings, rng), *_images(bench, rng), *_seen(bench, rng)]


def _blocks(bench, happenings, rng):
    """One block for every frame; frames of a tenth of a second share their way, and some are lost."""
    mavs = {own: dialect.MAVLink(None, *own) for own in (AUTOPILOT, CAMERA, RIVAL)}
    arrived_ms, blocks, sequence = 0.0, [], 0
    for k in range(SECONDS * 10):
        if happenings.reboots and 240 <= k < 260:
            continue
        held_ms = 1100.0 if k == 350 else 0.0
        held_ms += 300.0 * any(start_s <= k / 10 < stop_s for start_s, stop_s in happenings.late_s)
        arrived_ms = max(arrived_ms, 100 * k + 20 + held_ms + rng.exponential(15))
        for j, (speaker, message) in enumerate(_messages(bench, happenings, k)):
            sequence += 1
            mavs[speaker].seq = sequence % 256
            if rng.random() < 0.02 and k > 5:
                continue
            at_ns = bench.host0_ns + round(arrived_ms * MS) + j * 10_000
            sender = "companion" if happenings.has_companion and speaker != AUTOPILOT else "udp"
            frame = bytes(message.pack(mavs[speaker]))
            blocks.append(block_of(WireProtocol.MAVLINK, sender, [at_ns], [frame]))
    return blocks


def _messages(bench, happenings, k):
    """What is said in a tenth of a second, with the ids of who says it."""
    true_ms = 100 * k
    boot_ms = true_ms - 24_000 if happenings.reboots and k >= 240 else 60_000 + true_ms
    jump_ms = happenings.jump_s * 1000 if k >= 120 else 0.0
    utc_us = 0 if happenings.is_utc_late and k < 30 else bench.utc0_ns // 1000 + round((true_ms + jump_ms) * 1000)
    sway, lat, lon = 0.15 * math.sin(k / 5), -353_600_000 + 30 * k, 1_491_600_000
    down = [math.cos(math.pi / 6), 0.0, -math.sin(math.pi / 6), 0.0]
    said = [
        dialect.MAVLink_system_time_message(utc_us, boot_ms),
        dialect.MAVLink_attitude_message(boot_ms, 0.02, sway, 0.5 + 0.01 * k, 0, 0, 0),
        dialect.MAVLink_global_position_int_message(boot_ms, lat, lon, 634_000 + 10 * k, 50_000 + 10 * k, 0, 0, 0, 0),
    ]
    if not 200 <= k < 215:
        nan, flags = math.nan, 32 if 290 <= k < 293 else 0
        said.append(
            dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 44, down, nan, nan, nan, flags)
        )
    if 180 <= k < 260:
        said.append(dialect.MAVLink_mount_status_message(0, 0, -6000 - k, 0, 0))  # without a time of its own
    if not 80 <= k < 160 and k < 360:
        said.append(dialect.MAVLink_distance_sensor_message(boot_ms, 20, 10_000, 5_000 + k, 0, 0, 25, 0))
    if k % 10 == 0:
        said.append(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
    if k % 5 == 0:
        fix, accuracy = 1 if 180 <= k < 200 else 3, 800 + 40 * k
        said.append(
            dialect.MAVLink_gps_raw_int_message(1000 * boot_ms, fix, lat, lon, 0, 80, 120, 0, 0, 14, 0, accuracy, 1200)
        )
        compass = 1.3 if 280 <= k < 310 else 0.1
        said.append(dialect.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, compass, 0.1))
    if k % 5 == 2 and k < 200:
        said.append(dialect.MAVLink_terrain_report_message(lat, lon, 100, 584.0, 50.4 + 0.01 * k, 0, 500))
    others = [(RIVAL, dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))] if 320 <= k < 340 else []
    if k % 2 == 0 and 30 <= k < 300:
        zoom = dialect.MAVLink_camera_settings_message(boot_ms, 0, zoomLevel=max(0.0, min(k / 5 - 12, 60.0)))
        others.append((CAMERA, zoom))
    return [*((AUTOPILOT, message) for message in said), *others]


def _images(bench, rng):
    """Every 150 ms, on two clocks; some are stamps alone."""
    for k in range(int(SECONDS / 0.15)):
        clock = StampClock.HOST if k % 3 == 1 else StampClock.UTC
        image = bench.image(k, 37 + 150 * k, late_ms=int(rng.integers(0, 300)) if k % 5 == 0 else 15, clock=clock)
        yield replace(image, width_px=None, height_px=None) if k % 11 == 7 else image


def _seen(bench, rng):
    """What is seen in every second image: before or after that came, by name or by stamp, several at once."""
    for k in range(0, int(SECONDS / 0.15), 2):
        late_ms = int(rng.choice([5, 40, 400, 1500], p=[0.4, 0.4, 0.15, 0.05]))
        rest = {"late_ms": late_ms, "image": k if k % 3 == 0 else None}
        seen = [bench.observation(37 + 150 * k, **rest)]
        if k % 4 == 0:
            seen.append(bench.observation(37 + 150 * k, name="mark-a", pixels=((900.0, 500.0),), **rest))
        if k % 10 == 0:
            seen.append(bench.observation(37 + 150 * k, name="mark-p", pixels=((950.0, 520.0),), std_px=0.7, **rest))
        if k % 6 == 0:
            seen += [bench.observation(37 + 150 * k, name=OBJECTS, pixels=(), box=(1.0, 2.0, 9.0, 8.0), **rest)] * 2
        if k % 14 == 0:
            seen.append(bench.observation(37 + 150 * k, name="nobody's", **rest))
        on_host = k % 3 == 1
        stamp_ns = bench.host0_ns + (37 + 150 * k) * MS
        yield from (replace(each, clock=StampClock.HOST, stamp_ns=stamp_ns) if on_host else each for each in seen)
