"""Ticks that are recorded together are, message by message, what they are one after the other."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.geometry import camera_attitude
from aerodft.model import (
    CalibrationEstimate,
    Camera,
    Event,
    HeightSource,
    HeightSwitch,
    Image,
    Measurement,
    Observation,
    Pose,
    PoseSample,
    ProbeKind,
    ProjectionModel,
    Status,
    WireProtocol,
)
from aerodft.service import Batches, ImageOutputs, StepOutputs, block_of
from replay.recordings import Recording
from tests.batches import Content, measurement_batch, step_outputs

START_NS, TICK_NS, TICKS = 1_795_221_278_000_000_000, 50_000_000, 300
CAMERA = Camera.from_fov(name="cam", width_px=64, height_px=48, hfov_rad=1.0, vfov_rad=0.8)
STALE = {"status": Status.STALE_TELEMETRY, "pose": None}

Message = tuple[int, str, int, bytes]


def events_of(tick: int) -> list[Event]:
    """Frames of two senders, some at the same time, and now and then images and what is seen in them."""
    now_ns = START_NS + tick * TICK_NS
    events: list[Event] = [
        block_of(WireProtocol.MAVLINK, "udp:2", [now_ns - 30, now_ns - 10], [b"a%d" % tick, b"b"]),
        block_of(WireProtocol.MAVLINK, "udp:1", [now_ns - 20, now_ns - 10], [b"c", b"d"]),
    ]
    at = {"stamp_ns": now_ns - 40, "arrival_ns": now_ns - 10}
    events += [Image(index=3 * tick + k, **at) for k in range(tick % 3)]
    events += [Observation(name=name, pixels=((1.5, 2.0),), **at) for name in "xyx"[: tick % 4]]
    return events if tick % 17 else []


def contents_of(tick: int) -> list[Content]:
    """Poses, of which only some have a place for maps, and what else a tick comes to; of some nothing."""
    now_ns = START_NS + tick * TICK_NS
    sample = PoseSample(
        stamp_ns=now_ns - 40,
        status=Status.OK,
        pose=Pose(position_enu_m=np.array([1.0, 2.0, tick / 7]), wxyz=camera_attitude(0.5, 0.0, 1.0)),
        height_age_s=tick / 9 if tick % 5 else None,
        **({"lat_rad": 0.5, "lon_rad": 0.25, "alt_msl_m": 100.0} if tick % 7 else {}),
    )
    measurement = Measurement(
        name="w",
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=sample.stamp_ns,
        pixels=((1.0, 2.0), (3.0, 4.0)),
        std_px=1.0,
        camera="cam",
        model=ProjectionModel.PINHOLE,
        pose=sample,
        value=tick / 3,
        image=tick if tick % 2 else None,
    )
    contents: list[Content] = [sample, measurement]
    if tick % 11 == 0:
        contents = [replace(sample, reasons=(f"{tick} s old",), **STALE), *contents]
    if tick % 13 == 0:
        switch = HeightSwitch(stamp_ns=now_ns, before=HeightSource.HOME, after=HeightSource.RANGEFINDER, step=None)
        contents = [switch, *contents, CalibrationEstimate(stamp_ns=now_ns, calibration="live:x:1")]
    return contents if tick % 4 else []


def step(ticks: range) -> tuple[Batches, StepOutputs]:
    now_ns = START_NS + TICK_NS * np.array(ticks)
    batches = Batches.from_events(now_ns, [event for tick in ticks for event in events_of(tick)])
    return batches, step_outputs([contents_of(tick) for tick in ticks])


def recorded(folder: Path, cuts: list[int]) -> list[Message]:
    recorder = McapRecorder(folder, RecorderSettings(station="s", camera=CAMERA, lossless=True), started_ns=START_NS)
    for first, stop in pairwise(cuts):
        recorder.take(*step(range(first, stop)))
    recorder.close()
    assert recorder.totals.offered == recorder.totals.messages
    found = Recording(folder).messages(wanted=lambda channel: not channel.topic.endswith("/status"))
    return [(each.log_ns, each.channel.topic, each.sequence, each.data) for each in found]


@pytest.mark.parametrize("seed", range(3))
def test_how_ticks_are_cut_into_steps_changes_nothing(tmp_path: Path, seed: int) -> None:
    one_by_one = recorded(tmp_path / "ticks", list(range(1, TICKS + 1)))
    cuts = sorted({1, TICKS, *np.random.default_rng(seed).integers(1, TICKS, 7 * seed).tolist()})
    assert recorded(tmp_path / "steps", cuts) == one_by_one
    assert len(one_by_one) > 2000


def test_of_an_image_comes_its_pose_its_place_and_what_was_measured(tmp_path: Path) -> None:
    """Blocks of images may alternate; a place comes a few times a second."""
    sample, measurement = contents_of(1)
    assert isinstance(sample, PoseSample)
    assert isinstance(measurement, Measurement)
    ticks = np.arange(20)
    blocks = []
    for first in (0, 1):
        tick = ticks[first::2]
        stamps = [START_NS + 10 * k for k in tick.tolist()]
        measured = [[replace(measurement, stamp_ns=at)] for at in stamps]
        batch = measurement_batch(measured)
        blocks.append(ImageOutputs(tick=tick, order=tick, images=batch.images, poses=batch.poses, measurements=batch))
    batches = Batches(now_ns=START_NS + TICK_NS * (ticks + 1))
    recorder = McapRecorder(tmp_path / "r", RecorderSettings(station="s", camera=CAMERA), started_ns=START_NS)
    recorder.take(batches, StepOutputs(images=tuple(blocks)))
    recorder.close()
    found = Recording(tmp_path / "r").messages(wanted=lambda channel: not channel.topic.endswith("/status"))
    topics = [each.channel.topic.rpartition("/")[2] for each in found]
    expected = [["pose", *(["location"] if k % 4 == 0 else []), "measurements"] for k in range(20)]
    assert topics == [topic for image in expected for topic in image]
