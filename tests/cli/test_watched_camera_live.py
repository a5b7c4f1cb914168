"""A fixed camera that is bumped while ``serve`` watches it: a real stream, the bus, the recording."""

import time

import cv2
import numpy as np
import orjson
import pytest

from aerodft.adapters.bus import session_on
from aerodft.sim.live import udp_sender
from aerodft.sim.video import TransportStream
from replay.recordings import Recording
from tests.ports import free_endpoint, free_udp_port

from .test_serve import Service
from .test_watched_camera import BRIDGE, CAMERA, TURN, after_turn, pixels_after_the_bump, station_file, truth_m

RATE_HZ, BUMP_S, LENGTH_S = 8, 3, 8

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The exit code, the keys and payloads of the bus, the recording."""
    folder, size = tmp_path_factory.mktemp("served"), (CAMERA.width_px, CAMERA.height_px)
    picture = cv2.resize(cv2.imread(str(BRIDGE)), size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "reference.png"), picture)
    endpoint, port, turned, heard = free_endpoint(), free_udp_port(), after_turn(picture, TURN), []
    stream = f"udp://127.0.0.1:{port}"
    service = Service(
        station_file(folder, images={"stream": stream}, zenoh={"listen": endpoint}), "-o", folder / "recording"
    )
    try:
        service.wait_for("recording to")
        with (
            session_on(None, [endpoint]) as session,
            udp_sender(stream) as send,
            TransportStream(RATE_HZ) as video,
        ):
            session.declare_subscriber(
                "aerodft/bridge/*", lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes()))
            )
            began = time.monotonic()
            for index in range(LENGTH_S * RATE_HZ):
                shown = picture if index < BUMP_S * RATE_HZ else turned
                for datagram in video.encode(shown, index * 1_000_000_000 // RATE_HZ):
                    send(datagram)
                time.sleep(max(began + (index + 1) / RATE_HZ - time.monotonic(), 0.0))
            code = service.end()
    finally:
        service.end()
    return code, heard, folder / "recording"


def test_it_says_so_and_carries_on_with_the_right_numbers(served):
    code, _, recording = served
    assert code == 0
    found = [orjson.loads(payload) for payload in Recording(recording).measurements()]
    first, last = found[0], found[-1]
    assert first["reasons"] == []
    assert first["ci95"][0] < truth_m() < first["ci95"][1]
    assert last["status"] == "ok"
    assert last["reasons"][0].startswith("CAMERA_MOVED: turned by 2.00 deg")
    assert last["ci95"][0] < truth_m() < last["ci95"][1]
    np.testing.assert_allclose(last["pixels"], pixels_after_the_bump(), atol=0.2)


def test_the_bus_has_the_status_and_the_turn(served):
    statuses = [orjson.loads(payload) for key, payload in served[1] if key == "aerodft/bridge/status"]
    turns = [orjson.loads(payload) for key, payload in served[1] if key == "aerodft/bridge/camera_motion"]
    assert "CAMERA_MOVED" in orjson.dumps(statuses[-1]).decode()
    assert "CAMERA_MOVED" not in orjson.dumps(statuses[0]).decode()
    turned = np.array([turns[-1]["turn"][axis]["value"] for axis in ("tilt_deg", "pan_deg", "roll_deg")])
    np.testing.assert_allclose(turned, -np.degrees(TURN), atol=0.02)


def test_computed_anew_it_is_the_same_to_the_byte(served, aerodft, tmp_path):
    recording, again = served[2], tmp_path / "again"
    assert aerodft("recompute", recording, "-o", again).code == 0
    assert list(Recording(again).measurements()) == list(Recording(recording).measurements())
