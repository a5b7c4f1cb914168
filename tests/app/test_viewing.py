"""What a page shows of a recording is what was recorded; what it says of marks names no file that nobody knows."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import orjson

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.wire.pose import POSE_SCHEMA
from aerodft.adapters.wire.status import StationStatus
from aerodft.app.measure import MeasuredSurface
from aerodft.app.recordings import open_recording
from aerodft.app.viewing import FixedCameraView, RecordingView
from aerodft.app.viewing.live import Alerts

FROZEN = Path("tests/cli/frozen-0.1")


def test_an_image_is_measured_with_the_pose_that_was_recorded_with_it():
    recording = open_recording(FROZEN)
    view = RecordingView(recording)
    messages = recording.reader.messages(wanted=lambda channel: channel.schema == POSE_SCHEMA)
    recorded = {each["stamp_ns"]: each for each in (orjson.loads(message.data) for message in messages)}
    assert len(view.images) > 3
    for number, image in enumerate(view.images):
        _, sample = view.scene(number)
        expected = recorded[str(image.stamp_ns)]
        assert sample.status == expected["status"]
        if sample.pose is not None:
            np.testing.assert_array_equal(sample.pose.wxyz, expected["wxyz"])
            np.testing.assert_array_equal(sample.pose.cov, expected["cov"])


def test_every_cause_for_which_an_image_is_not_measured_is_an_alert():
    counts = {"dropped": 2, "too_many": 3, "damaged": 5, "not_later": 7, "unstamped": 11}
    unmeasured = {f"unmeasured_{cause}": count for cause, count in counts.items()}
    status = StationStatus(station="a", stamp_ns=0, state="live", counts=unmeasured)
    alerts = Alerts()
    alerts.status(status)
    said = {each["key"]: each["text"] for each in alerts.now(10**12)}
    assert said["load"].startswith("5 images were not measured")
    assert said["stream"].startswith("12 images were not measured"), "the first half second of a stream is none"


def test_a_wrong_lens_is_named_and_nothing_is_used():
    camera = load_camera(Path("configs/cameras/demo-1080p.toml"))
    zoomed = replace(camera, fx_px=1.4 * camera.fx_px, fy_px=1.4 * camera.fy_px)
    view = FixedCameraView(Path("configs/calibration/bridge.jpg"), zoomed, None, {}, MeasuredSurface())
    evidence = tomllib.loads(Path("configs/calibration/bridge-landmarks.toml").read_text())
    unknowns = ["position", "height", "tilt", "roll", "heading"]
    found = view.calibrate({"landmark": evidence["landmark"]}, unknowns, accept=False, use=True)
    assert found["status"] == "ILL_CONDITIONED"
    assert found["reasons"][0].startswith("what was marked: the image is not of this camera's mode")
    assert "file" not in found
    assert view.seen(0)["pose"] is None
