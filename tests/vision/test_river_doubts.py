"""What else the river may be: where two looks disagree, and other arms; and what frames a picture is no bank."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.model import PoseSample, Status
from aerodft.reports.river.document import doubts
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import Island, furnished_world
from aerodft.sim.world import River as SimulatedRiver
from aerodft.vision.river import (
    NoRiver,
    Reach,
    River,
    RiverHints,
    RiverQuestion,
    RiverView,
    WaterNetwork,
    WaterPlane,
    find_river,
    measure_reach,
)
from tests.vision.painted_rivers import CAMERA, PaintedRiver


class TwoMinds:
    """In place of a network as OpenCV has it: it sees other water at each look, the second one mirrored."""

    def __init__(self, first, second):
        self.looks = [first, second[:, ::-1]]

    def setInput(self, blob):  # noqa: N802 - OpenCV's name
        self.size = blob.shape[3], blob.shape[2]

    def forward(self):
        seen = self.looks.pop(0)
        wet = cv2.resize(seen.astype(np.float32), self.size, interpolation=cv2.INTER_AREA)
        return (8.0 * wet - 4.0)[None, None]


def in_two_minds(scene, strip):
    """Intervals and true widths where one look ends at ``strip`` of the width beyond the eastern bank, one at it."""
    u, v = np.meshgrid(np.arange(960.0), np.arange(540.0))
    places = WaterPlane(CAMERA, scene.pose).places_en_m(np.stack([u, v], axis=-1))
    beyond, _, across = scene.beyond_bank_m(places[..., 0], places[..., 1])
    other = beyond < np.where(across > 0, strip * scene.width_m, 0.0)
    network = WaterNetwork(TwoMinds(beyond < 0, other), Path("two minds"))
    found = find_river(scene.picture(), Setup(camera=CAMERA), scene.pose, RiverQuestion(network=network))
    assert isinstance(found, River)
    left, right = np.moveaxis(WaterPlane(CAMERA, scene.pose).places_en_m(found.edges.pixels_px[found.rows]), 1, 0)
    unit = (left - right) / np.linalg.norm(left - right, axis=-1, keepdims=True)
    true = np.array([scene.crossing_m(*line) for line in zip((left + right) / 2, unit, strict=True)])[found.used]
    return found, *found.widths.ci95_m[found.used].T, true


def test_an_interval_reaches_to_the_banks_of_both_looks():
    """An even path along the river, a tenth of its width: one look takes it for water, the other does not."""
    scene = PaintedRiver(seed=3, water="sky", land="grass", tilt_deg=20.0, look={"path": 0.1})
    found, low, high, true = in_two_minds(scene, 0.1)
    assert np.mean((low <= true) & (true <= high)) > 0.95
    assert np.mean((low <= 1.1 * true) & (1.1 * true <= high)) > 0.9
    assert any("two looks" in said for said in doubts([found.water])) == (found.water.agreement < 0.9)


def test_where_the_looks_disagree_the_clearer_outline_is_the_bank():
    """A bank that the water mirrors fades into it: one look takes the strip for land, the other for water."""
    scene = PaintedRiver(seed=3, water="sky", land="grass", tilt_deg=40.0, look={"mirror": 0.2})
    found, low, high, true = in_two_minds(scene, -0.2)
    assert np.median(np.abs(found.widths.width_m[found.used] / true - 1)) < 0.002
    assert np.mean((low <= 0.85 * true) & (true <= high)) > 0.9


def test_an_arm_behind_a_long_island_is_said():
    """The island leaves the image at both ends: nothing tells that the arms are one river."""
    river = SimulatedRiver(
        width_m=40.0, width_swing_m=0.0, meander_m=0.0, islands=(Island(station_m=0.0, length_m=400.0, width_m=8.0),)
    )
    camera = default_camera(960, 540)
    pose = camera_pose(height_agl_m=100.0, tilt_rad=0.0)
    image = Renderer(camera, furnished_world(river), SensorModel()).render(pose, 1.0)
    found = find_river(image, Setup(camera=camera), pose, RiverQuestion(hints=RiverHints([(480.0, 375.0)], [])))
    assert isinstance(found, River)
    assert found.water.apart > 0.5
    assert any("another arm" in said for said in doubts([found.water]))


def test_left_of_many_images_is_as_the_first_that_shows_the_river_has_it():
    """The first image, of a meadow far off, looks south; the second looks north along the river."""
    scene = PaintedRiver(seed=3, water="blue", land="grass", tilt_deg=0.0)
    away = camera_pose(height_agl_m=40.0, tilt_rad=0.0, heading_rad=np.pi, east_m=500.0)
    meadow = np.random.default_rng(1).normal((50.0, 120.0, 85.0), 8.0, (540, 960, 3)).astype(np.uint8)
    views = [
        RiverView(
            index, Setup(camera=CAMERA), PoseSample(stamp_ns=0, status=Status.OK, pose=pose), partial(np.copy, image)
        )
        for index, (image, pose) in enumerate(((meadow, away), (scene.picture(), scene.pose)))
    ]
    reach = measure_reach(views, RiverQuestion(spacing_m=4.0))
    assert isinstance(reach, Reach)
    assert isinstance(reach.looks[0], NoRiver)
    _, north_m = reach.line.places_en_m[-1] - reach.line.places_en_m[0]
    assert north_m > 10.0


def test_black_borders_are_no_banks():
    """A picture in a black frame that leans, as after undistortion; it hides a part of the left bank."""
    scene = PaintedRiver(seed=2, water="blue", land="grass", tilt_deg=20.0, width_m=30.0)
    image = scene.picture()
    u, v = np.meshgrid(np.arange(960), np.arange(540))
    framed = np.where(((u > 260 + 0.1 * v) & (u < 800 + 0.1 * v))[..., None], image, 0).astype(np.uint8)
    whole, part = (find_river(each, Setup(camera=CAMERA), scene.pose, RiverQuestion()) for each in (image, framed))
    assert isinstance(whole, River)
    assert isinstance(part, River)
    assert len(part.rows) < len(whole.rows)
    np.testing.assert_allclose(np.median(part.widths.width_m), np.median(whole.widths.width_m), rtol=0.006)
    edge = np.stack([part.edges.pixels_px[..., 0] - 260 - 0.1 * part.edges.pixels_px[..., 1]], axis=-1)
    assert np.nanmin(edge) > 8.0
    assert np.nanmax(edge) < 540.0 - 8.0
