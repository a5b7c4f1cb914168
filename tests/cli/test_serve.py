"""The live service as its user meets it: real processes, real sockets, a subscriber on the bus, and a signal."""

import io
import json
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import jsonschema
import PIL.Image
import pytest
import tomli_w
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations

from aerodft.adapters.bus import session_on
from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.model import Image
from aerodft.sim import default_camera
from replay.compare import compare_measurements
from replay.recordings import Recording, RecordingSource
from tests.adapters.outputs.foxglove_client import Viewer
from tests.ports import free_endpoint, free_tcp_port, free_udp_port

PATIENCE_S = 60.0


def write_station(folder, endpoint, **tables):
    (folder / "camera.toml").write_text(tomli_w.dumps(camera_document(default_camera(640, 360))))
    document = {
        "station": {"name": "live"},
        "camera": {"file": "camera.toml"},
        "zenoh": {"listen": endpoint},
        "probe": [
            {"name": "width-a", "kind": "distance", "observed": True},
            {"name": "centre", "kind": "position", "pixels": [[319.5, 179.5]]},
        ],
        **tables,
    }
    (folder / "station.toml").write_text(tomli_w.dumps(document))
    return folder / "station.toml"


class Service:
    """``aerodft serve`` as a process, with what it says."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "aerodft", "serve", *map(str, arguments)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.said = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        self.said.extend(iter(self.process.stderr.readline, ""))

    def wait_for(self, text):
        until = time.monotonic() + PATIENCE_S
        while not any(text in line for line in self.said):
            assert self.process.poll() is None, self.said
            assert time.monotonic() < until, self.said
            time.sleep(0.02)

    def end(self, number=signal.SIGTERM):
        """End it, once or more often; returns its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(PATIENCE_S)
        self._reader.join()
        self.process.stdout.close()
        self.process.stderr.close()
        return code


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A short live flight: the folder, what a subscriber and a viewer got, and the service's words and exit code."""
    folder = tmp_path_factory.mktemp("live")
    endpoint, mavlink, video, foxglove = free_endpoint(), free_udp_port(), free_udp_port(), free_tcp_port()
    config = write_station(
        folder,
        endpoint,
        telemetry={"connection": f"udpin:127.0.0.1:{mavlink}", "height": {"order": ["home"]}},
        images={"stream": f"udp://127.0.0.1:{video}"},
        foxglove={"port": foxglove, "image_hz": 100.0},
    )
    service = Service(config, "-o", folder / "recording")
    simulator = [
        *(sys.executable, "-m", "aerodft.sim", "--out", folder / "flight", "--live", "--duration", 5, "--fps", 8),
        *("--camera", folder / "camera.toml", "--mavlink", f"udpout:127.0.0.1:{mavlink}"),
        *("--video", f"udp://127.0.0.1:{video}", "--zenoh", endpoint, "--station", "live"),
    ]
    received = []
    try:
        service.wait_for("recording to")
        with session_on(None, [endpoint]) as session, Viewer(foxglove) as viewer:
            subscriber = session.declare_subscriber(
                "aerodft/**", lambda sample: received.append((str(sample.key_expr), sample.payload.to_bytes()))
            )
            subprocess.run(list(map(str, simulator)), check=True, capture_output=True, timeout=PATIENCE_S)
            time.sleep(1.0)  # what is under way arrives; the counts below tell if it did not
            code = service.end()
            time.sleep(0.5)  # what it says as it ends, likewise
            subscriber.undeclare()
    finally:
        service.end()
    return folder, received, viewer, service.said, code


def test_a_signal_ends_it_cleanly_and_it_says_where_the_recording_is(flown):
    folder, _, _, said, code = flown
    assert code == 0
    assert any(f"recording: {folder / 'recording'}" in line for line in said)
    assert Recording(folder / "recording").is_whole


def test_a_subscriber_gets_every_measurement_valid_against_the_schema(flown):
    folder, received, *_ = flown
    got = [payload for key, payload in received if key.startswith("aerodft/live/measurement/")]
    assert got == list(Recording(folder / "recording").measurements())
    validator = jsonschema.Draft202012Validator(SCHEMAS["aerodft.measurement/1"])
    for payload in got:
        validator.validate(json.loads(payload))
    assert "centre" in {json.loads(payload)["name"] for payload in got}


def test_image_pose_and_status_are_on_the_bus_too(flown):
    _, received, *_ = flown
    keys = {key for key, _ in received}
    assert {"aerodft/live/pose", "aerodft/live/status", "aerodft/live/image"} <= keys


def test_a_viewer_sees_what_is_recorded_and_what_is_drawn_over_the_images(flown):
    folder, _, viewer, said, _ = flown
    recording, root = Recording(folder / "recording"), "aerodft/live"
    recorded = {(message.channel.topic, message.data) for message in recording.messages()}
    for topic in ("measurements", "pose", "image", "location", "status"):
        got = viewer.of(f"{root}/{topic}")
        assert got
        assert topic == "status" or {(f"{root}/{topic}", data) for data in got} <= recorded
    assert not any("mavlink" in topic for topic in viewer.channels)
    images = {int(json.loads(data)["stamp_ns"]) for topic, data in recorded if topic == f"{root}/image"}
    pictures = list(map(CompressedImage.FromString, viewer.of(f"{root}/image/jpeg")))
    assert {picture.timestamp.ToNanoseconds() for picture in pictures} <= images
    assert PIL.Image.open(io.BytesIO(pictures[-1].data)).size == (640, 360)
    camera = CameraCalibration.FromString(viewer.of(f"{root}/camera")[-1])
    transform = FrameTransform.FromString(viewer.of(f"{root}/transform")[-1])
    assert pictures[-1].frame_id == camera.frame_id == transform.child_frame_id
    drawn = [ImageAnnotations.FromString(data) for data in viewer.of(f"{root}/annotations")]
    assert {each.timestamp.ToNanoseconds() for drawing in drawn for each in drawing.texts} <= images
    numbers = [json.loads(data)["value"] for data in viewer.of(f"{root}/number/centre")]
    values = [each["value"] for each in map(json.loads, recording.measurements()) if each["name"] == "centre"]
    assert len(numbers) > 10
    later = iter(values)
    assert all(number in later for number in numbers)  # in order; a slow viewer misses some
    assert numbers[-1] == values[-1]
    assert any("ws://127.0.0.1:" in line for line in said)


def test_live_recomputed_is_the_same_to_the_byte(aerodft, flown, tmp_path):
    folder, *_ = flown
    assert aerodft("recompute", folder / "recording", "-o", tmp_path / "again").code == 0
    comparison = compare_measurements(folder / "recording", tmp_path / "again")
    assert comparison.is_identical
    assert comparison.total.paired > 20


def test_recorded_images_have_pixels(flown):
    folder, *_ = flown
    source = RecordingSource(Recording(folder / "recording"), pixels=True)
    shown = [event for event in source.events() if isinstance(event, Image) and event.pixels]
    assert shown
    assert shown[0].pixels().shape == (360, 640, 3)


FIXED = {"height_agl_m": 8.0, "tilt_deg": 60.0}


def test_a_fixed_camera_answers_questions(tmp_path):
    endpoint = free_endpoint()
    config = write_station(tmp_path, endpoint, pose=FIXED, images={"rate_hz": 20.0})
    service = Service(config, "-o", tmp_path / "recording")
    try:
        service.wait_for("recording to")
        question = json.dumps({"kind": "range", "pixels": [[319.5, 179.5]]})
        with session_on(None, [endpoint]) as session:
            replies = [
                r.ok.payload.to_bytes() for r in session.get("aerodft/live/measure", payload=question, timeout=10)
            ]
        (answers,) = map(json.loads, replies)
        assert answers[0]["status"] == "ok"
        assert answers[0]["value"] == pytest.approx(16.0, abs=0.1)  # 8 m / cos 60 deg
    finally:
        assert service.end(signal.SIGINT) == 0


def test_busy_ports_are_named(aerodft, tmp_path):
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        config = write_station(
            tmp_path, free_endpoint(), telemetry={"connection": f"udpin:127.0.0.1:{port}"}, images={"rate_hz": 5.0}
        )
        done = aerodft("serve", config, "-o", tmp_path / "recording")
    assert done.code == 3
    assert str(port) in done.last


def test_busy_bus_endpoint_is_named(aerodft, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = aerodft(
            "serve",
            write_station(tmp_path, endpoint, pose=FIXED, images={"rate_hz": 5.0}),
            "-o",
            tmp_path / "recording",
        )
    assert done.code == 3
    assert endpoint in done.err


def test_busy_port_of_the_viewer_is_named(aerodft, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        config = write_station(tmp_path, free_endpoint(), pose=FIXED, images={"rate_hz": 5.0}, foxglove={"port": port})
        done = aerodft("serve", config, "-o", tmp_path / "recording")
    assert done.code == 3
    assert f"127.0.0.1:{port}" in done.last


def test_recorded_input_is_for_import(aerodft, tmp_path):
    config = write_station(
        tmp_path, free_endpoint(), pose=FIXED, images={"video": "v.mp4", "start": 1795221278868833000}
    )
    Path(tmp_path / "v.mp4").touch()
    done = aerodft("serve", config, "-o", tmp_path / "recording")
    assert done.code == 3
    assert "use import" in done.err
