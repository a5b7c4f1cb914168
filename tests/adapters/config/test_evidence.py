"""What people write about a scene is read as it stands: TOML, CSV, local metres, degrees, projections."""

import hashlib
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.evidence import check_against, load_evidence
from aerodft.geometry import camera_attitude, matrix
from aerodft.model import (
    EvidenceSet,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    Prior,
    SlantRange,
    Vertical,
)

CONFIGS = Path(__file__).parents[3] / "configs"
EXAMPLE = CONFIGS / "calibration" / "bridge-landmarks.toml"
DEMO = CONFIGS / "cameras" / "demo-1080p.toml"


def loaded(folder, text, name="x.toml", crs=None):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return load_evidence(path, crs)


SITE = """
crs = "local"
[camera]
height_agl_m = { value = 10.48, std = 0.5 }
tilt_deg = { value = 67.0, std = 2.0 }
roll_deg = 1.5
focal_px = { value = 1500, std = 10 }
position_m = { value = [3, -4.5], std = [0.1, 0.2] }
[[landmark]]
name = "p1"
pixel = [812.0, 604.5]
position_m = [12.3, 45.6, 0.0]
std_px = 1.5
[[landmark]]
pixel = [12, 4]
position_m = [12.5, "?", 1]
std_m = [0.1, 0.2, 0.3]
[[range]]
pixel = [1944.0, 493.0]
range_m = 68.84
std_m = 0.1
[[ground]]
pixel = [1944.0, 493.0]
xy_m = [0.0, 68.0]
[[length]]
pixels = [[100.0, 500.0], [300.0, 510.0]]
length_m = 5.14
elevation_m = 0.4
[[height]]
base = [640.0, 400.0]
top = [641.0, 300.0]
height_m = 1.76
[[horizon]]
pixels = [[0.0, 120.0], [1919.0, 131.0], [-400, 99]]
sea = true
[[vertical]]
pixels = [[1, 2], [3, 4]]
std_px = 0.25
[[parallel]]
name = "quay"
lines = [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]
[[right_angle]]
lines = [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]
"""


def test_every_kind_is_read_as_it_stands(tmp_path):
    found = loaded(tmp_path, SITE)
    assert found.known.evidence == (
        Landmark(name="p1", pixel=(812.0, 604.5), position_m=(12.3, 45.6, 0.0), std_px=1.5),
        Landmark(name="landmark-2", pixel=(12, 4), position_m=(12.5, None, 1.0), std_m=(0.1, 0.2, 0.3)),
        SlantRange(name="range-1", pixel=(1944.0, 493.0), range_m=68.84, std_m=0.1),
        GroundPoint(name="ground-1", pixel=(1944.0, 493.0), xy_m=(0.0, 68.0)),
        KnownLength(name="length-1", pixels=((100.0, 500.0), (300.0, 510.0)), length_m=5.14, elevation_m=0.4),
        KnownHeight(name="height-1", base=(640.0, 400.0), top=(641.0, 300.0), height_m=1.76),
        Horizon(name="horizon-1", pixels=((0.0, 120.0), (1919.0, 131.0), (-400.0, 99.0)), is_sea=True),
        Vertical(name="vertical-1", pixels=((1.0, 2.0), (3.0, 4.0)), std_px=0.25),
        GroundLines(name="quay", first=((1, 2), (3, 4)), second=((5, 6), (7, 8)), at_right_angle=False),
        GroundLines(name="right_angle-1", first=((1, 2), (3, 4)), second=((5, 6), (7, 8)), at_right_angle=True),
    )
    assert found.known.priors == {
        "height": Prior(value=10.48, std=0.5),
        "tilt": Prior(value=math.radians(67.0), std=math.radians(2.0)),
        "roll": Prior(value=math.radians(1.5), std=0.0),
        "focal": Prior(value=1500.0, std=10.0),
        "east": Prior(value=3.0, std=0.1),
        "north": Prior(value=-4.5, std=0.2),
    }
    assert found.fixed == {"roll"}
    assert (found.image, found.image_size_px) == (None, None)
    assert found.sha256 == hashlib.sha256(SITE.encode()).hexdigest()
    assert [each.label for each in found.stated][:3] == ["landmark[0]", "landmark[1]", "range[0]"]


def test_heights_count_from_the_stated_ground(tmp_path):
    text = (
        "elevation_m = { value = 138.27, std = 0.02 }\n"
        '[image]\nfile = "a.jpg"\nwidth_px = 1920\nheight_px = 1080\n'
        "[camera]\nposition_m = [1, 2, 144.27]\n"
        "[[landmark]]\npixel = [1, 2]\nposition_m = [3, 4, 139.27]\n"
    )
    found = loaded(tmp_path, text)
    assert found.known.priors["elevation"] == Prior(value=0.0, std=0.02)
    assert found.known.priors["height"].value == pytest.approx(6.0, abs=1e-12)
    assert found.fixed == {"east", "north", "height"}
    assert_allclose(found.known.evidence[0].position_m, (3, 4, 1), atol=1e-12)
    assert_allclose(found.frame.file_coordinates([3, 4, 1]), (3, 4, 139.27), atol=1e-12)
    assert (found.image, found.image_size_px) == ("a.jpg", (1920, 1080))
    assert loaded(tmp_path, text.replace(", std = 0.02", "")).fixed >= {"elevation"}
    assert found.frame.geo_origin is None
    assert found.frame.true_heading_rad(1.0) is None


def test_the_example_is_a_view_of_the_camera_that_it_names():
    found, camera = load_evidence(EXAMPLE), load_camera(DEMO)
    check_against(found, camera)
    at_m, to_enu = np.array([3.2, -1.5, 7.93]), matrix(camera_attitude(*np.radians([62.3, -0.6, 127.4])))
    lens = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    turn, _ = cv2.Rodrigues(to_enu.T)

    def seen(points_m):
        points_m = np.array(points_m, dtype=np.float64)
        shift = -to_enu.T @ at_m
        return cv2.projectPoints(points_m, turn, shift, lens, np.array(camera.distortion))[0].reshape(-1, 2)

    whole = [each for each in found.known.evidence if isinstance(each, Landmark) and None not in each.position_m]
    off_px = seen([each.position_m for each in whole]) - [each.pixel for each in whole]
    assert len(whole) == 7
    assert np.sqrt(np.mean(off_px**2)) < 0.7
    for each in found.known.evidence:
        if isinstance(each, GroundPoint):
            heading = math.radians(127.4)
            ahead, right = (
                np.array([math.sin(heading), math.cos(heading)]),
                np.array([math.cos(heading), -math.sin(heading)]),
            )
            foot = at_m[:2] + each.xy_m[0] * right + each.xy_m[1] * ahead
            assert_allclose(seen([[*foot, 0.0]])[0], each.pixel, atol=0.1)
    assert {type(each) for each in found.known.evidence} == {
        Landmark, SlantRange, GroundPoint, KnownLength, KnownHeight, Vertical, GroundLines,
    }  # fmt: skip


def test_the_examples_horizon_is_one(tmp_path):
    text = EXAMPLE.read_text().replace("# [[horizon]]\n# pix", "[[horizon]]\npix").replace("# sea", "sea")
    found = loaded(tmp_path, text)
    check_against(found, load_camera(DEMO))  # a horizon may be off the image
    assert found.known.evidence[-1].is_sea


NUMBERS = st.floats(-2e4, 2e4)  # landmarks 100 km apart would be refused
PIXELS = st.tuples(NUMBERS, NUMBERS)
STD_PX = st.floats(1e-3, 1e3)
STD_M = st.floats(0, 100)
LENGTHS = st.floats(1e-3, 1e5)
LINES = st.tuples(PIXELS, PIXELS).filter(lambda line: line[0] != line[1])
TWO_LINES = st.tuples(LINES, LINES).filter(lambda lines: set(lines[0]) != set(lines[1]))
POSITIONS = st.tuples(NUMBERS, NUMBERS, NUMBERS, st.sampled_from([0, 1, 2, None])).map(
    lambda drawn: tuple(None if axis == drawn[3] else drawn[axis] for axis in range(3))
)
STDS = {"std_px": STD_PX, "std_m": STD_M}
KINDS = {
    "landmark": st.fixed_dictionaries(
        {"pixel": PIXELS, "position_m": POSITIONS, "std_px": STD_PX, "std_m": st.tuples(STD_M, STD_M, STD_M)}
    ),
    "range": st.fixed_dictionaries({"pixel": PIXELS, "range_m": LENGTHS, **STDS}),
    "ground": st.fixed_dictionaries({"pixel": PIXELS, "xy_m": PIXELS, **STDS}),
    "length": st.fixed_dictionaries({"pixels": LINES, "length_m": LENGTHS, "elevation_m": NUMBERS, **STDS}),
    "height": LINES.flatmap(
        lambda line: st.fixed_dictionaries(
            {"base": st.just(line[0]), "top": st.just(line[1]), "height_m": LENGTHS, **STDS}
        )
    ),
    "vertical": st.fixed_dictionaries({"pixels": LINES, "std_px": STD_PX}),
    "parallel": st.fixed_dictionaries({"lines": TWO_LINES, "std_px": STD_PX}),
    "right_angle": st.fixed_dictionaries({"lines": TWO_LINES, "std_px": STD_PX}),
    "horizon": st.fixed_dictionaries(
        {
            "pixels": st.lists(PIXELS, min_size=2, max_size=4, unique=True).map(tuple),
            "sea": st.booleans(),
            "std_px": STD_PX,
        }
    ),
}  # fmt: skip
CLASSES = {
    "landmark": Landmark, "range": SlantRange, "ground": GroundPoint, "length": KnownLength, "height": KnownHeight,
    "vertical": Vertical,
}  # fmt: skip
PRIORS = {
    "height_agl_m": ("height", st.floats(0.1, 1e4)),
    "tilt_deg": ("tilt", st.floats(0, 180)),
    "roll_deg": ("roll", st.floats(-180, 180)),
    "heading_deg": ("heading", st.floats(-360, 360)),
    "focal_px": ("focal", st.floats(1, 1e5)),
    "position_m": ("east north", st.tuples(NUMBERS, NUMBERS)),
}


def made(kind, row, name):
    if kind in ("parallel", "right_angle"):
        first, second = row["lines"]
        return GroundLines(
            name=name, first=first, second=second, at_right_angle=kind != "parallel", std_px=row["std_px"]
        )
    if kind == "horizon":
        return Horizon(name=name, pixels=row["pixels"], is_sea=row["sea"], std_px=row["std_px"])
    return CLASSES[kind](name=name, **row)


def is_sound(rows):
    """Landmarks of which none is there twice."""
    landmarks = [row for kind, row in rows if kind == "landmark"]
    wholes = [row["position_m"] for row in landmarks if None not in row["position_m"]]
    return len({row["pixel"] for row in landmarks}) == len(landmarks) and len(set(wholes)) == len(wholes)


@st.composite
def evidence_sets(draw):
    """An EvidenceSet, and it as a document; kinds in any order, each kind's rows together as TOML has them."""
    kinds = draw(st.permutations(sorted(KINDS)))
    rows = [(kind, row) for kind in kinds for row in draw(st.lists(KINDS[kind], max_size=3))]
    rows = rows if is_sound(rows) and rows else [("vertical", {"pixels": ((0.0, 1.0), (2.0, 3.0)), "std_px": 0.5})]
    document, evidence = {"camera": {}}, []
    for index, (kind, row) in enumerate(rows):
        name = f"n{index}"
        evidence.append(made(kind, row, name))
        place = (
            {"position_m": ["?" if each is None else each for each in row["position_m"]]} if kind == "landmark" else {}
        )
        document.setdefault(kind, []).append({"name": name, **row, **place})
    priors, fixed = {}, set()
    for key in draw(st.sets(st.sampled_from(sorted(PRIORS)))):
        names, values = PRIORS[key]
        value, std = draw(values), draw(st.one_of(st.none(), st.floats(1e-4, 100)))
        document["camera"][key] = value if std is None else {"value": value, "std": std}
        is_angle = key.endswith("_deg")
        for name, each in zip(names.split(), value if key == "position_m" else [value], strict=True):
            fixed |= {name} if std is None else set()
            one, spread = (math.radians(each), math.radians(std or 0.0)) if is_angle else (each, std or 0.0)
            priors[name] = Prior(value=one, std=spread)
    return EvidenceSet(evidence=tuple(evidence), priors=priors), fixed, document


@given(drawn=evidence_sets())
def test_whatever_is_written_is_read_again(tmp_path_factory, drawn):
    known, fixed, document = drawn
    path = tmp_path_factory.mktemp("evidence") / "x.toml"
    path.write_text(tomli_w.dumps(document), encoding="utf-8")
    found = load_evidence(path)
    assert found.known == known
    assert found.fixed == fixed
