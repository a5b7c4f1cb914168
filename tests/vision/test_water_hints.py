"""What a person says of water and land wins over the network, spreads to where it ends, and is carried along."""

import json
import math
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.errors import InputError
from aerodft.geometry import camera_pose
from aerodft.vision.river import River, RiverHints, RiverQuestion, WaterNetwork, WaterPlane, find_river
from aerodft.vision.river.water.hints import with_hints
from aerodft.vision.river.water.plane import SmallCopy
from tests.vision.painted_rivers import CAMERA, PaintedRiver

RIVER = PaintedRiver(seed=4, water="brown", land="grass", tilt_deg=20.0, bend_m=2.0)


@pytest.fixture(scope="module")
def shot():
    """The picture, and where its water is."""
    u, v = np.meshgrid(np.arange(960.0), np.arange(540.0))
    places = WaterPlane(CAMERA, RIVER.pose).places_en_m(np.stack([u, v], axis=-1))
    return RIVER.picture(), RIVER.beyond_bank_m(places[..., 0], places[..., 1])[0] < 0


class Blind:
    """In place of a network as OpenCV has it: it holds everything for land, or for water."""

    def __init__(self, logit):
        self.logit = logit

    def setInput(self, blob):  # noqa: N802 - OpenCV's name
        self.shape = blob.shape[2:]

    def forward(self):
        return np.full((1, 1, *self.shape), self.logit, dtype=np.float32)


@pytest.mark.parametrize("logit", [-2.0, 2.0], ids=["sees land", "sees water"])
def test_a_point_in_the_water_and_one_on_each_bank_mend_a_network_that_sees_nothing(shot, logit):
    image, wet = shot
    rows = np.flatnonzero(wet[270])
    middle, left, right = rows.mean(), rows.min() - 120.0, rows.max() + 120.0
    hints = RiverHints([(middle, 270.0)], [(left, 270.0), (right, 270.0)])
    copy = SmallCopy.of_image(image)
    blind = tuple(np.full(copy.shape, logit, dtype=np.float32) for _ in range(2))
    seen = with_hints(copy, blind, hints)[0] > 0
    true = cv2.resize(wet.astype(np.uint8), copy.shape[::-1]) > 0
    assert np.count_nonzero(seen & true) / np.count_nonzero(seen | true) > 0.8


def test_a_mask_says_all_and_the_banks_are_found_in_the_image(shot):
    """The mask is drawn 6 px too wide, as by hand; banks are where the picture has them."""
    image, wet = shot
    drawn = 255 * cv2.dilate(wet.astype(np.uint8), np.ones((13, 13), np.uint8))
    question = RiverQuestion(hints=RiverHints(mask=drawn), network=WaterNetwork(Blind(-3.0), Path("blind")))
    found = find_river(image, Setup(camera=CAMERA), RIVER.pose, question)
    assert isinstance(found, River)
    left, right = np.moveaxis(WaterPlane(CAMERA, RIVER.pose).places_en_m(found.edges.pixels_px[found.rows]), 1, 0)
    unit = (left - right) / np.linalg.norm(left - right, axis=-1, keepdims=True)
    true = np.array([RIVER.crossing_m(*line) for line in zip((left + right) / 2, unit, strict=True)])
    assert np.median(np.abs(found.widths.width_m / true - 1)) < 0.01


def test_hints_are_carried_on_the_water():
    """From 40 m up a point that is seen at one pixel is seen by a camera that moved where the ground point went."""
    there = WaterPlane(CAMERA, camera_pose(height_agl_m=40.0, tilt_rad=0.3))
    here = WaterPlane(CAMERA, camera_pose(height_agl_m=45.0, tilt_rad=0.35, north_m=3.0, heading_rad=math.radians(5)))
    hints = RiverHints([[(480.0, 300.0), (520.0, 310.0)]], [(959.0, 539.0)])
    moved = hints.carried(there, here)
    places = there.places_en_m(np.array([[480.0, 300.0], [520.0, 310.0]]))
    np.testing.assert_allclose(here.places_en_m(moved.water[0]), places, atol=1e-6)
    gone = WaterPlane(CAMERA, camera_pose(height_agl_m=40.0, tilt_rad=0.3, east_m=500.0))
    assert not hints.carried(there, gone)


def test_hints_from_files(tmp_path):
    (tmp_path / "hints.json").write_text(json.dumps({"water": [[1, 2], [[3, 4], [5, 6]]], "land": [[7, 8]]}))
    hints = RiverHints.read(tmp_path / "hints.json")
    assert [each.tolist() for each in hints.water] == [[[1.0, 2.0]], [[3.0, 4.0], [5.0, 6.0]]]
    assert [each.tolist() for each in hints.land] == [[[7.0, 8.0]]]
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((4, 6), 255, np.uint8))
    assert RiverHints.read(tmp_path / "mask.png").mask.shape == (4, 6)


def test_files_that_are_no_hints_are_refused_and_pipes_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    os.mkfifo(tmp_path / "pipe.onnx")
    header = struct.pack(">4sIIBBBBB", b"IHDR", 50_000, 50_000, 8, 2, 0, 0, 0)
    crc = zlib.crc32(header).to_bytes(4, "big")
    (tmp_path / "large.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\r" + header + crc)
    for name, words in (
        ("pipe.json", "no file of hints"),
        ("nothing.png", "no file of hints"),
        ("large.png", "no mask"),
    ):
        with pytest.raises(InputError, match=words):
            RiverHints.read(tmp_path / name)
    with pytest.raises(InputError, match="no file"):
        WaterNetwork.read(tmp_path / "pipe.onnx")


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"water": [[1, 2, 3]]}', '{"land": ["here"]}', '{"water": [[1, NaN]]}', '{"land": 5}', "[" * 9000],
)
def test_what_is_no_hint_is_one_sentence(tmp_path, text):
    (tmp_path / "hints.json").write_text(text)
    with pytest.raises(InputError, match="hint"):
        RiverHints.read(tmp_path / "hints.json")
