"""What a page shows of a recording is what was recorded."""

from pathlib import Path

import numpy as np
import orjson

from aerodft.adapters.wire.pose import POSE_SCHEMA
from aerodft.app.recordings import open_recording
from aerodft.app.viewing import RecordingView

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
