"""The folder of ``aerodft calibrate --report``: files that parse and say what was found, whatever was observed."""

import csv
import hashlib
import math
import re

import cv2
import numpy as np
import pytest

from tests.nights import at_night

CAMERA = """
name = "yard | 1"
width_px = {width}
height_px = {height}
fx_px = {focal}
fy_px = {focal}
cx_px = {cx}
cy_px = {cy}
"""
EAST, NORTH, UP, TILT_DEG = 4.0, -3.0, 9.0, 68.0
FOCAL = 700.0
FILES = {"annotated.jpg", "residuals.png", "residuals.csv", "report.md"}
PROJECTED = (192_100.0, 313_150.0)


def pixel(x, y, up=0.0, width=960, height=540, focal=FOCAL):
    """Of a point right and ahead of a camera that looks north, by hand."""
    sin, cos = math.sin(math.radians(TILT_DEG)), math.cos(math.radians(TILT_DEG))
    down = UP - up
    depth = y * sin + down * cos
    return [(width - 1) / 2 + focal * x / depth, (height - 1) / 2 + focal * (down * sin - y * cos) / depth]


def landmarks(places, at=lambda x, y, up: [x + EAST, y + NORTH, up], **view):
    return "".join(
        f'[[landmark]]\nname = "p{index}"\npixel = {pixel(*place, **view)}\nposition_m = {at(*place)}\n'
        for index, place in enumerate(places)
    )


PLACES = [(-4.0, 12.0, 0.0), (5.0, 14.0, 0.4), (-6.0, 25.0, 0.1), (8.0, 30.0, 0.0), (1.0, 18.0, 1.0), (-2.0, 50.0, 0.0)]
HORIZON_V = 269.5 - FOCAL / math.tan(math.radians(TILT_DEG))
OTHERS = f"""
[[range]]
pixel = {pixel(1.0, 20.0)}
range_m = {math.hypot(1, 20, UP)}
[[ground]]
pixel = {pixel(-3.0, 22.0)}
xy_m = [-3.0, 22.0]
[[length]]
pixels = [{pixel(-2.0, 16.0)}, {pixel(2.0, 19.0)}]
length_m = 5.0
[[height]]
base = {pixel(3.0, 21.0)}
top = {pixel(3.0, 21.0, 2.0)}
height_m = 2.0
[[vertical]]
pixels = [{pixel(-5.0, 20.0)}, {pixel(-5.0, 20.0, 3.0)}]
[[parallel]]
lines = [[{pixel(0.0, 13.0)}, {pixel(1.0, 30.0)}], [{pixel(4.0, 16.0)}, {pixel(5.0, 33.0)}]]
[[right_angle]]
lines = [[{pixel(0.0, 13.0)}, {pixel(1.0, 30.0)}], [{pixel(-3.0, 20.0)}, {pixel(14.0, 19.0)}]]
[[horizon]]
pixels = [[100.0, {HORIZON_V}], [800.0, {HORIZON_V}]]
"""
POSE = "position,height,tilt,roll,heading"


@pytest.fixture
def calibrated(aerodft, tmp_path):
    """Calibrate from a file's text; the report's folder."""

    def run(text, *more, unknowns=POSE, width=960, height=540, focal=FOCAL, code=0):
        camera = tmp_path / "camera.toml"
        camera.write_text(
            CAMERA.format(width=width, height=height, focal=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)
        )
        site, report = tmp_path / "site.toml", tmp_path / "reports" / "yard"
        site.write_text(text)
        done = aerodft(
            "calibrate", site, "--camera", camera, "--unknowns", unknowns, "--report", report, "--json", *more
        )
        assert done.code == code, done.err
        return done, report

    return run


def read(report):
    with (report / "residuals.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return cv2.imread(str(report / "annotated.jpg")), rows, (report / "report.md").read_text(encoding="utf-8")


def table(markdown, head):
    """Rows of the table whose head begins so."""
    lines = markdown.splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith(f"| {head} |"))
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines[first:] if line.startswith("|")]
    count = next((k for k, line in enumerate(lines[first:]) if not line.startswith("|")), len(rows))
    assert len({len(row) for row in rows[:count]}) == 1
    return [[cell.strip() for cell in row] for row in rows[2:count]]


def test_every_kind_of_evidence_is_in_the_folder(calibrated, tmp_path):
    done, report = calibrated(landmarks(PLACES) + OTHERS)
    assert {each.name for each in report.iterdir()} == FILES
    image, rows, words = read(report)
    assert image.shape[1] == 1280
    assert cv2.imread(str(report / "residuals.png")).shape[1] > 1000
    kinds = ["range", "ground", "length", "height", "vertical", "parallel", "right_angle", "horizon"]
    assert [row["kind"] for row in rows] == ["landmark"] * 6 + kinds
    assert all(float(row["residual_px"]) < 0.01 and row["left_out"] == "no" for row in rows)
    assert math.isclose(float(rows[5]["range_m"]), math.hypot(2, 50, UP), rel_tol=1e-3)
    assert rows[-1]["range_m"] == ""
    assert len(table(words, "observation")) == len(rows)
    assert "(annotated.jpg)" in words
    assert "(residuals.png)" in words
    assert hashlib.sha256((tmp_path / "site.toml").read_bytes()).hexdigest() in words
    found = {name: float(value) for name, value, *_ in table(words, "unknown")}
    assert math.isclose(found["tilt\\_deg"], TILT_DEG, abs_tol=1e-3)
    assert math.isclose(found["height\\_agl\\_m"], UP, abs_tol=1e-3)
    assert found.keys() == {each.replace("_", "\\_") for each in done.json["parameters"]}
    assert len(table(words, "correlation")) == 6


def test_the_papers_model_and_no_landmark(calibrated):
    text = "".join(
        f"[[range]]\npixel = [480.0, {270 - math.degrees(math.atan(y / UP) - math.radians(68)) / vfov * 540}]\n"
        f"range_m = {math.hypot(y, UP)}\n"
        for vfov in [2 * math.degrees(math.atan(270 / FOCAL))]
        for y in (12.0, 20.0, 35.0, 60.0)
    )
    done, report = calibrated(text, "--model", "dft", unknowns="height,tilt")
    assert math.isclose(done.json["parameters"]["tilt_deg"]["value"], 68.0, abs_tol=1e-3)
    _, rows, words = read(report)
    assert "the paper's equations" in words
    assert all(abs(float(row["off_u_px"])) < 1e-6 for row in rows)
    assert "heading\\_deg 0" in words


def test_an_outlier_is_named_and_points_to_where_it_belongs(calibrated):
    u, v = pixel(*PLACES[2])
    text = landmarks(PLACES).replace(f"{[u, v]}", f"{[u + 60, v + 10]}")
    _, report = calibrated(text)
    image, rows, words = read(report)
    assert [row["name"] for row in rows if row["left_out"] == "yes"] == ["p2"]
    assert math.isclose(float(rows[2]["off_u_px"]), -60, abs_tol=0.5)
    assert "Left out: p2." in words
    assert "- Rejected p2: it is 61 px from where the estimated camera would see it." in words
    scale = 1280 / 960
    blue, green, red = np.moveaxis(image[: round(540 * scale)].astype(int), -1, 0)
    is_red = (red > 200) & (green < 110) & (blue < 110)
    down, across = np.nonzero(is_red)
    assert is_red[round((v + 5.5) * scale) - 3 : round((v + 5.5) * scale) + 4, round((u + 30.5) * scale)].any()
    assert across.min() < (u + 5) * scale
    assert down.size > 50


def test_the_image_is_shown_and_crosses_are_on_it(calibrated, tmp_path):
    green = np.zeros((540, 960, 3), dtype=np.uint8)
    green[:] = (30, 110, 40)
    cv2.imwrite(str(tmp_path / "yard.png"), green)
    done, report = calibrated('[image]\nfile = "yard.png"\n' + landmarks(PLACES))
    image, _, words = read(report)
    assert "canvas" not in words
    assert "no image" not in done.err
    shown = image[:720]
    assert np.median(np.abs(shown.astype(int) - (30, 110, 40)).max(axis=-1)) < 8
    for place in PLACES:
        u, v = ((each + 0.5) * 1280 / 960 - 0.5 for each in pixel(*place))
        around = shown[max(round(v) - 2, 0) : round(v) + 3, round(u) - 2 : round(u) + 3]
        assert (around[..., 2].astype(int) - around[..., 0]).max() > 120  # yellow


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda path: path.with_suffix(".jpg"), "no such file"),
        *at_night(
            (lambda path: path.mkdir(), "no such file"),
            (lambda path: path.write_bytes(b""), "not a readable image"),
            (lambda path: path.write_bytes(b"\xff\xd8\xff no image"), "not a readable image"),
        ),
    ],
    ids=["missing", "folder", "empty", "damaged"],
)
def test_an_image_that_cannot_be_used_is_said(calibrated, tmp_path, write, said):
    write(tmp_path / "yard.png")
    done, report = calibrated('[image]\nfile = "yard.png"\n' + landmarks(PLACES))
    assert said in done.err
    assert f"{said}: the canvas is plain" in read(report)[2].replace("\\", "")


def test_an_image_of_another_size_is_refused(calibrated, tmp_path):
    cv2.imwrite(str(tmp_path / "yard.png"), np.zeros((8, 9, 3), np.uint8))
    done, report = calibrated('[image]\nfile = "yard.png"\n' + landmarks(PLACES), code=3)
    assert "yard.png: the image is not of this camera's mode: got 9 x 8 px, expected 960 x 540 px" in done.last
    assert not report.exists()


def test_a_folder_that_cannot_be_written_is_refused(calibrated, tmp_path):
    (tmp_path / "reports").write_text("a file")
    done, _ = calibrated(landmarks(PLACES), code=3)
    assert "the report cannot be written" in done.last


def test_names_are_shown_as_they_are(calibrated):
    names = ["a|b", "Brücke $x$", "<img src=x>", "*_[]`", "河岸", "long " * 40 + "end"]
    text = landmarks(PLACES)
    for index, name in enumerate(names):
        text = text.replace(f'name = "p{index}"', f'name = "{name}"')
    _, report = calibrated(text)
    _, rows, words = read(report)
    assert [row["name"] for row in rows] == names
    shown = [re.sub(r"\\(.)", r"\1", row[0]) for row in table(words, "observation")]
    assert shown == names
    assert "# Calibration of yard \\| 1" in words


@pytest.mark.nightly
def test_landmarks_far_above_the_zero_of_heights_carry_the_grid(calibrated):
    _, report = calibrated(landmarks(PLACES, lambda x, y, up: [x, y, up + 640.0]))
    assert re.search(r"The grid is drawn at the landmarks' middle height, 640\.\d+ m", read(report)[2])


def test_projected_coordinates_are_told_in_the_file_s(calibrated):
    text = 'crs = "EPSG:28992"\nelevation_m = 20.0\n'
    text += landmarks(PLACES, lambda x, y, up: [PROJECTED[0] + x, PROJECTED[1] + y, up + 20.0])
    words = read(calibrated(text)[1])[2]
    east, north, up = map(float, re.search(r"camera is at (\S+), (\S+), (\S+) in", words).groups())
    assert math.dist((east, north, up), (*PROJECTED, 29.0)) < 0.05
    assert re.search(r"WGS84: 50\.8\d+, 5\.9\d+", words.replace("\\", ""))


@pytest.mark.parametrize(("width", "wide"), [(64, 1280), *at_night((2400, 2400), (6000, 3840))])
def test_pictures_are_as_large_as_the_image_within_reason(calibrated, width, wide):
    view = {"width": width, "height": width * 9 // 16, "focal": width * FOCAL / 960}
    _, report = calibrated(landmarks(PLACES, **view), **view)
    height, found, _ = read(report)[0].shape
    assert found == wide
    assert wide * 9 // 16 < height < wide * 11 // 16


def test_as_many_unknowns_as_observations_say_so(calibrated):
    text = f"[[range]]\npixel = {pixel(0.0, 12.0)}\nrange_m = {math.hypot(12, UP)}\n"
    text += f"[[range]]\npixel = {pixel(0.0, 40.0)}\nrange_m = {math.hypot(40, UP)}\n"
    words = read(calibrated(text, unknowns="height,tilt")[1])[2]
    assert "There are no more observations than unknowns" in words
