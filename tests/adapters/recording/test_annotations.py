"""What an exported file gives viewers, read back by other libraries than the one that wrote it."""

import json
from collections import defaultdict
from pathlib import Path

import numpy as np
import orjson
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from aerodft.adapters.wire.keys import Keys
from aerodft.app.recordings import export, open_recording
from replay.recordings import Recording

FROZEN = Path("tests/cli/frozen-0.1")
ROOT = "aerodft/frozen"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("exported") / "flight.mcap"
    export(FROZEN, path)
    return path


@pytest.fixture(scope="module")
def messages(exported):
    """By topic: schema, message record, decoded content."""
    found = defaultdict(list)
    with exported.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "protobuf":
                content = DecoderFactory().decoder_for("protobuf", schema)(message.data)
            else:
                content = json.loads(message.data) if channel.message_encoding == "json" else None
            found[channel.topic].append((schema, message, content))
    return found


def test_each_image_has_the_lines_and_values_of_its_probes(messages):
    images = {content["index"]: content for _, _, content in messages[f"{ROOT}/image"]}
    drawn = messages[f"{ROOT}/annotations"]
    assert len(drawn) > 10
    by_stamp = {content["stamp_ns"]: each for each, content in ((each, each) for each in images.values())}
    for schema, message, content in drawn:
        assert schema.name == "foxglove.ImageAnnotations"
        assert len(content.points) == len(content.texts) > 0
        stamps = {each.timestamp.seconds * 10**9 + each.timestamp.nanos for each in content.points}
        (stamp_ns,) = stamps
        assert message.log_time >= int(by_stamp[str(stamp_ns)]["arrival_ns"])  # the very image's


def test_the_last_drawing_of_an_image_has_all_of_its_probes(messages):
    """A viewer keeps one message of a topic for each stamp."""
    measured = defaultdict(set)
    for payload in map(orjson.loads, open_recording(FROZEN).reader.measurements()):
        if payload["image"] is not None and payload["pixels"]:
            measured[payload["image"]].add(payload["name"])
    stamps = {content["index"]: int(content["stamp_ns"]) for _, _, content in messages[f"{ROOT}/image"]}
    last = {}
    for _, _, content in messages[f"{ROOT}/annotations"]:
        at = content.points[0].timestamp
        last[at.seconds * 10**9 + at.nanos] = {text.text.partition(":")[0] for text in content.texts}
    assert len(measured) > 10
    assert {image: last[stamps[image]] for image in measured} == measured


def test_a_label_says_value_and_interval_or_the_status(messages):
    recorded = {}
    for payload in map(orjson.loads, open_recording(FROZEN).reader.measurements()):
        recorded[payload["stamp_ns"], payload["name"]] = payload
    labels = {
        (str(text.timestamp.seconds * 10**9 + text.timestamp.nanos), text.text.partition(":")[0]): text.text
        for _, _, content in messages[f"{ROOT}/annotations"]
        for text in content.texts
    }
    answered = [key for key in labels if key in recorded and recorded[key]["value"] is not None]
    assert answered
    for key in answered:
        low, high = recorded[key]["ci95"]
        assert f"[{low:.2f} ... {high:.2f}] 95 %" in labels[key]
    refused = [key for key in labels if key in recorded and recorded[key]["status"] != "ok"]
    assert all(labels[key].endswith(recorded[key]["status"]) for key in refused)


def test_a_probe_has_a_topic_with_its_number(messages):
    recorded = [orjson.loads(each) for each in open_recording(FROZEN).reader.measurements()]
    for name in {each["name"] for each in recorded}:
        own = [content for _, _, content in messages[f"{ROOT}/number/{name}"]]
        expected = [each for each in recorded if each["name"] == name]
        assert [each["value"] for each in own] == [each["value"] for each in expected]
        assert [each["low"] for each in own] == [(each["ci95"] or [None])[0] for each in expected]


def test_transforms_are_the_poses(messages):
    poses = [content for _, _, content in messages[f"{ROOT}/pose"] if content["wxyz"] is not None]
    transforms = [content for _, _, content in messages[f"{ROOT}/transform"]]
    assert len(transforms) == len(poses) > 10
    for pose, found in zip(poses, transforms, strict=True):
        q = found.rotation
        turn = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        axis = turn @ [0.0, 0.0, 1.0]  # where the camera looks, in east, north and up
        assert np.degrees(np.arccos(-axis[2])) == pytest.approx(pose["tilt_deg"], abs=1e-9)
        assert [found.translation.x, found.translation.y, found.translation.z] == pose["position_enu_m"]
        assert found.parent_frame_id == "enu"


def test_the_file_is_the_same_recording_all_the_same(exported):
    assert list(Recording(exported).measurements()) == list(Recording(FROZEN).measurements())


def test_the_layout_names_topics_that_there_are():
    layout = json.loads(Path("configs/foxglove/river.json").read_text())
    panels, keys = layout["configById"], Keys("demo")
    tabs = {tab["layout"] for tab in panels["Tab!pictures"]["tabs"]}
    assert panels.keys() == {"Tab!pictures", *tabs, "map!way", "3D!camera", "Plot!width", "Plot!pose"}
    images = [panels[tab]["imageMode"] for tab in tabs]
    assert {image["imageTopic"] for image in images} == {keys.video, keys.jpeg}
    assert all(keys.annotations in image["annotations"] for image in images)
