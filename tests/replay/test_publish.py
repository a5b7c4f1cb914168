"""Replay on the bus: everything, in order, as it was, to another process."""

import subprocess
import sys
import textwrap
import time
from pathlib import Path
from queue import Queue

import numpy as np
import orjson
import pytest
import zenoh

from aerodft.adapters.bus import session_on
from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.adapters.wire.measurement import encode_measurement
from aerodft.geometry import camera_attitude
from aerodft.model import Camera, Image, Measurement, Pose, PoseSample, ProbeKind, ProjectionModel, Status
from replay.player import Player, Republisher, is_published, timeline
from replay.player.publish import PublisherPool
from replay.recordings import Recording
from tests.batches import one_tick, take
from tests.clock import VirtualClock
from tests.ports import free_endpoint

START_NS = 1_795_221_278_000_000_000
TICK_NS = 50_000_000

LISTENER = """
    import json, sys, zenoh
    config = zenoh.Config()
    for key, value in (
        ("mode", "peer"), ("listen/endpoints", []), ("connect/endpoints", [sys.argv[1]]),
        ("connect/exit_on_failure", False), ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session, session.declare_subscriber("aerodft/**") as subscriber:
        for sample in subscriber:
            attachment = sample.attachment
            print(json.dumps([str(sample.key_expr), sample.payload.to_bytes().hex(),
                              None if attachment is None else attachment.to_string()]), flush=True)
            if b'"ending"' in sample.payload.to_bytes():
                break
"""


def value_at(step: int) -> Measurement:
    sample = PoseSample(
        stamp_ns=step, status=Status.OK, pose=Pose(position_enu_m=np.zeros(3), wxyz=camera_attitude(0.5, 0.0, 1.0))
    )
    return Measurement(
        name="w",
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=START_NS + step * TICK_NS,
        pixels=((1.0, 2.0), (3.0, 4.0)),
        std_px=1.0,
        camera="c",
        model=ProjectionModel.PINHOLE,
        pose=sample,
        value=step / 3,
    )


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    camera = Camera.from_fov(name="c", width_px=8, height_px=6, hfov_rad=1, vfov_rad=1)
    settings = RecorderSettings(station="s", camera=camera, lossless=True, max_image_hz=1e6)
    recorder = McapRecorder(tmp_path / "r", settings, started_ns=START_NS)
    for step in range(1, 401):
        now_ns = START_NS + step * TICK_NS
        taken_ns = now_ns - 5
        shot = Image(
            index=step,
            stamp_ns=taken_ns,
            arrival_ns=taken_ns,
            width_px=8,
            height_px=6,
            pixels=lambda: np.zeros((6, 8, 3), np.uint8),
        )
        batch = one_tick(now_ns, [shot] if step % 40 == 0 else [])
        take(recorder, batch, value_at(step).pose, value_at(step))
    recorder.close()
    return Recording(tmp_path / "r")


def played(recording: Recording, publisher: Republisher) -> None:
    Player(outlets=[publisher], clock=VirtualClock(), rate=None).play(
        lambda: timeline([recording], None, None, is_published)
    )


def test_another_process_receives_every_measurement_in_order_byte_by_byte(recording: Recording) -> None:
    endpoint = free_endpoint()
    with (
        subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(LISTENER), endpoint], stdout=subprocess.PIPE
        ) as process,
        session_on(endpoint) as session,
    ):
        publisher = Republisher(session)
        assert publisher.wait_for_link(20.0)
        assert publisher.wait_for_subscriber([recording], 20.0)
        played(recording, publisher)
        totals = publisher.published
        assert publisher.has_listeners
        publisher.close()
        assert process.stdout is not None
        got = [orjson.loads(line) for line in process.stdout]
    assert (totals.measurements, totals.others, totals.images) == (400, 402, 10)
    measured = [bytes.fromhex(data) for key, data, _ in got if key == "aerodft/s/measurement/w"]
    assert measured == [encode_measurement(value_at(step)) for step in range(1, 401)]
    images = [(bytes.fromhex(data)[:2], orjson.loads(note)) for key, data, note in got if key == "aerodft/s/image"]
    assert [note["index"] for _, note in images] == list(range(40, 401, 40))
    assert {magic for magic, _ in images} == {b"\xff\xd8"}


def test_waiting_for_nobody_ends(recording: Recording) -> None:
    start_s = time.monotonic()
    with session_on(None) as session:
        publisher = Republisher(session)
        assert not publisher.wait_for_link(0.05)
        assert not publisher.wait_for_subscriber([recording], 0.05)
        played(recording, publisher)
        assert not publisher.has_listeners
        publisher.close()
    assert time.monotonic() - start_s < 10


def test_more_keys_than_are_declared_all_arrive_and_listeners_are_noticed() -> None:
    endpoint, keys = free_endpoint(), 1200
    got: Queue[str] = Queue()
    with session_on(endpoint) as session, session_on(None, [endpoint]) as other:
        publishers = PublisherPool(session)
        publishers.put("many/before", b"", zenoh.Encoding.ZENOH_BYTES)
        assert not publishers.has_listeners
        subscriber = other.declare_subscriber("many/**", lambda sample: got.put(str(sample.key_expr)))
        end_s = time.monotonic() + 20
        while not publishers.has_listeners and time.monotonic() < end_s:
            time.sleep(0.01)
        sent, arrived = {f"many/{key}" for key in range(keys)}, set()
        for key in sent:
            publishers.put(key, b"", zenoh.Encoding.ZENOH_BYTES)
        while not sent <= arrived:
            arrived.add(got.get(timeout=20))
        assert arrived - sent <= {"many/before"}  # sessions that have just met may still deliver it
        subscriber.undeclare()
        publishers.close()


def test_a_listener_to_any_one_of_many_keys_is_noticed() -> None:
    endpoint = free_endpoint()
    with session_on(endpoint) as session, session_on(None, [endpoint]) as other:
        publishers = PublisherPool(session)
        with other.declare_subscriber("many/170"):
            for _ in range(20):
                for key in range(200):
                    publishers.put(f"many/{key}", b"", zenoh.Encoding.ZENOH_BYTES)
                time.sleep(0.05)
        assert publishers.has_listeners  # noticed while it was there
        publishers.close()
