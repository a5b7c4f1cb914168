"""What a page shows of a recording is what was recorded; what it says of marks names no file that nobody knows."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import orjson

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.wire.pose import POSE_SCHEMA
from aerodft.app.measure import MeasuredSurface
from aerodft.app.recordings import open_recording
from aerodft.app.viewing import FixedCameraView, RecordingView

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
