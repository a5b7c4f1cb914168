"""The page in a real browser: what people click is what ``aerodft measure`` says, to the last digit shown."""

import csv
import json
import math
import re
import shlex
import tomllib

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect

from tests.commands import run_aerodft
from tests.web.pages import (
    PATIENCE_MS,
    copied,
    needs_browser,
    numbers,
    opened_page,
    shown,
    shown_measurement,
    shown_number,
    value_of,
)

RECORDING = "tests/cli/frozen-0.1"
HEIGHT_M, TILT_DEG, FOCAL_PX, SIZE = 20.0, 50.0, 800.0, (960, 640)

pytestmark = needs_browser


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """An image of a river between two banks that are 12 m apart, straight ahead, and its options."""
    folder = tmp_path_factory.mktemp("still")
    width, height = SIZE
    image = np.full((height, width, 3), (60, 120, 80), dtype=np.uint8)
    banks = [seen(x, y) for x, y in ((-6.0, 15.0), (-6.0, 60.0), (6.0, 60.0), (6.0, 15.0))]
    cv2.fillPoly(image, [np.rint(banks).astype(np.int32)], (150, 110, 60))
    cv2.imwrite(str(folder / "river.png"), image)
    camera = f'name = "c"\nwidth_px = {width}\nheight_px = {height}\nfx_px = {FOCAL_PX}\nfy_px = {FOCAL_PX}\n'
    (folder / "camera.toml").write_text(f"{camera}cx_px = {(width - 1) / 2}\ncy_px = {(height - 1) / 2}\n")
    return folder / "river.png", ["--camera", folder / "camera.toml", "--height", HEIGHT_M, "--tilt", TILT_DEG]


def seen(x_m, y_m, z_m=0.0):
    """Pixel of a point to the right, ahead and above the ground below the camera, by the pinhole."""
    tilt, up = math.radians(TILT_DEG), z_m - HEIGHT_M
    depth = y_m * math.sin(tilt) - up * math.cos(tilt)
    down = -y_m * math.cos(tilt) - up * math.sin(tilt)
    return (SIZE[0] - 1) / 2 + FOCAL_PX * x_m / depth, (SIZE[1] - 1) / 2 + FOCAL_PX * down / depth


@pytest.fixture(scope="module")
def address(still):
    path, options = still
    with opened_page(path, *options) as where:
        yield where


@pytest.fixture(scope="module")
def without_pose(still):
    path, options = still
    with opened_page(path, *options[:2]) as where:
        yield where


@pytest.fixture
def page(browser, address):
    yield from shown(browser, address)


def click(page, pixel):
    """Click a pixel of the image, as near as the screen's pixels allow."""
    x, y = place(page, pixel)
    page.mouse.move(x, y)
    page.mouse.click(x, y)


def place(page, pixel):
    box = page.locator("#image").bounding_box()
    scale = min(box["width"] / SIZE[0], box["height"] / SIZE[1])
    left, top = (box["width"] - SIZE[0] * scale) / 2, (box["height"] - SIZE[1] * scale) / 2
    return box["x"] + left + (pixel[0] + 0.5) * scale, box["y"] + top + (pixel[1] + 0.5) * scale


def test_two_banks_are_as_far_apart_as_they_are(page):
    for x_m in (-6.0, 6.0):
        click(page, seen(x_m, 30.0))
    value, low, high = numbers(value_of(page))
    assert low < 12.0 < high
    assert abs(value - 12.0) < 0.2
    assert (high - low) / value < 0.3
    expect(page.locator("#budget span").first).to_be_visible()
    assert "%" in page.locator("#advice").inner_text()


def test_the_numbers_are_those_of_the_command_line_wherever_it_runs(page, tmp_path, monkeypatch):
    for x_m in (-6.0, 6.0):
        click(page, seen(x_m, 30.0))
    shown_text, command, document = value_of(page), copied(page, "command"), json.loads(copied(page, "json"))
    shares = [int(each) for each in re.findall(r"(\d+) %", page.inner_text("#shares"))]
    assert 98 <= sum(shares) <= 101
    assert page.inner_text("#advice").startswith(f"{max(shares)} % from")
    monkeypatch.chdir(tmp_path)
    _, *words = shlex.split(command)
    (found,) = run_aerodft(*words, "--json").json
    assert shown_text == shown_measurement(found)
    assert document == found
    reasons = page.locator("#reasons li").all_inner_texts()
    assert reasons == found["reasons"]
    assert "std of pixels assumed: 1 px" in reasons


def test_heights_of_points_are_those_of_the_command_line(page, tmp_path, monkeypatch):
    for x_m in (-6.0, 6.0):
        click(page, seen(x_m, 30.0))
    level = value_of(page)
    page.fill("#heights", "0,5; 0")
    page.fill("#heights-std", "0.1")
    page.press("#heights-std", "Tab")
    expect(page.locator("#measurements .value")).not_to_have_text(level, timeout=PATIENCE_MS)
    page.wait_for_function("() => document.querySelector('#copies').ariaBusy === 'false'")
    probe, command = copied(page, "probe"), copied(page, "command")
    assert tomllib.loads(probe)["probe"][0]["elevation_m"] == [0.5, 0]
    monkeypatch.chdir(tmp_path)
    (found,) = run_aerodft(*shlex.split(command)[1:], "--json").json
    assert value_of(page) == shown_measurement(found)
    for _ in range(2):  # the std, then the heights
        page.keyboard.press("Control+z")
    expect(page.locator("#measurements .value")).to_have_text(level, timeout=PATIENCE_MS)
    page.fill("#heights", "a metre")
    page.press("#heights", "Tab")
    expect(page.locator("#measurements .value")).to_contain_text("elevation_m", timeout=PATIENCE_MS)


def test_a_dragged_point_and_what_was_taken_back(page):
    for x_m in (-6.0, 6.0):
        click(page, seen(x_m, 30.0))
    before = value_of(page)
    page.mouse.move(*place(page, seen(6.0, 30.0)))
    page.mouse.down()
    page.mouse.move(*place(page, seen(3.0, 30.0)), steps=5)
    page.mouse.up()
    expect(page.locator("#measurements .value")).not_to_have_text(before, timeout=PATIENCE_MS)
    page.wait_for_function(
        "() => Math.abs(parseFloat(document.querySelector('#measurements .value').textContent) - 9) < 0.2",
        timeout=PATIENCE_MS,
    )
    page.keyboard.press("Control+z")
    expect(page.locator("#measurements .value")).to_have_text(before, timeout=PATIENCE_MS)


def test_the_height_of_a_post(page):
    page.click("[data-kind=height]")
    click(page, seen(2.0, 20.0))
    page.mouse.move(*place(page, seen(2.0, 20.0, 2.0)))
    page.wait_for_timeout(300)
    click(page, seen(2.0, 20.0, 3.0))
    value, low, high = numbers(value_of(page))
    assert low < 3.0 < high
    assert abs(value - 3.0) < 0.1


def test_a_kind_without_a_button_is_measured_as_well(page):
    """The registry says what there is to measure, and how many points it takes: the azimuth of a single one."""
    assert {"bearing", "range", "river"} <= set(page.locator("#others option").all_inner_texts())
    page.select_option("#others", "range")
    click(page, seen(0.0, 15.0))
    value, low, high = numbers(value_of(page))
    assert low < math.hypot(15.0, HEIGHT_M) < high
    assert abs(value - math.hypot(15.0, HEIGHT_M)) < 0.2
    page.click("[data-kind=width]")
    expect(page.locator("#others")).to_have_value("")


def test_what_scrolls_is_a_landmark_that_keys_reach(page):
    plots = page.locator("section#over-time")
    expect(plots).to_have_attribute("tabindex", "0")
    expect(plots).to_have_attribute("aria-label", "Values over time")
    assert plots.evaluate("(each) => getComputedStyle(each).overflowY") == "auto"


def test_a_refusal_is_said_in_words_where_the_pointer_is(browser, still):
    path, options = still
    with opened_page(path, *options[:-1], 80) as address:
        for page in shown(browser, address):
            page.mouse.move(*place(page, (480, 20)))
            expect(page.locator("#pointer")).to_contain_text("ABOVE_HORIZON", timeout=PATIENCE_MS)


def test_a_recording_is_scrubbed_and_shows_what_is_recomputed(browser, tmp_path):
    assert run_aerodft("recompute", RECORDING, "-o", tmp_path / "again").code == 0
    assert run_aerodft("export", tmp_path / "again", "--format", "csv", "-o", tmp_path / "again.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "again.csv").read_text().splitlines()))
    with opened_page(RECORDING) as address:
        for page in shown(browser, address):
            box = page.locator("#image").bounding_box()
            for share in (0.4, 0.6):
                page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.6 * box["height"])
            for number, key in ((5, "."), (6, "."), (5, ",")):
                page.keyboard.press(key)
                expect(page.locator("#when")).to_contain_text(f"image {number} of", timeout=PATIENCE_MS)
                stamp = page.locator("#when").get_attribute("title")[:23]
                recomputed = [row for row in rows if row["time_utc"][:23].replace("T", " ") == stamp and row["value"]]
                assert len(recomputed) >= 2
                for row in recomputed:
                    value = shown_number(*(float(row[each]) for each in ("value", "ci95_low", "ci95_high")))
                    line = page.locator("#probes li", has_text=f"{row['name']}: ")
                    expect(line).to_contain_text(f": {value} ", timeout=PATIENCE_MS)
            _, *words = shlex.split(copied(page, "command"))
            measured = shown_measurement(run_aerodft(*words, "--json").json[0])
            expect(page.locator("#measurements .value")).to_have_text(measured, timeout=PATIENCE_MS)


def test_a_river_s_banks_are_mended_by_two_strokes(browser):
    camera = "configs/cameras/demo-1080p.toml"
    options = ["--camera", camera, "--height", 7.93, "--tilt", 62.3, "--roll", -0.6, "--std", "height=0.1,tilt=0.2"]
    with opened_page("configs/calibration/bridge.jpg", *options) as address:
        for page in shown(browser, address):
            page.click("#river")
            expect(page.locator("#reach-width")).to_contain_text("transects", timeout=PATIENCE_MS)
            before = page.inner_text("#reach-width")
            command = ["river", "configs/calibration/bridge.jpg", *options, "--spacing", 1, "--json"]
            median = run_aerodft(*command).json["width_m"]["median"]
            assert abs(float(before.split(" ")[0]) - median) < 0.05
            box = page.locator("#image").bounding_box()
            for side, across in (("water", 0.5), ("land", 0.05)):
                page.click(f"[data-kind={side}]")
                page.mouse.move(box["x"] + across * box["width"], box["y"] + 0.55 * box["height"])
                page.mouse.down()
                page.mouse.move(box["x"] + across * box["width"], box["y"] + 0.7 * box["height"], steps=4)
                page.mouse.up()
            expect(page.locator("#reach-width")).not_to_have_text(before, timeout=PATIENCE_MS)
            page.click("#forget")
            expect(page.locator("#reach-width")).to_have_text(before, timeout=PATIENCE_MS)


def test_a_camera_is_calibrated_from_four_landmarks_and_the_width_follows(browser, still):
    path, options = still
    with opened_page(path, *options[:4], "--tilt", TILT_DEG + 4) as address:
        for page in shown(browser, address):
            for x_m in (-6.0, 6.0):
                click(page, seen(x_m, 30.0))
            before = value_of(page)
            assert numbers(before)[0] > 13.0
            page.click("[data-kind=landmark]")
            places = [(-6.0, 15.0), (-6.0, 45.0), (6.0, 45.0), (6.0, 15.0)]
            page.click("#landmarks summary")
            page.fill("#list", "\n".join(f"corner-{row},{x},{y},0" for row, (x, y) in enumerate(places)))
            page.click("#take")
            for x_m, y_m in places:
                click(page, seen(x_m, y_m))
            expect(page.locator("#parameters")).to_contain_text("tilt50.", timeout=PATIENCE_MS)
            page.click("#use")
            expect(page.locator("#solved")).to_contain_text("Saved as", timeout=PATIENCE_MS)
            with page.expect_download() as download:
                page.click("#export")
            assert "tilt_deg" in tomllib.loads(download.value.path().read_text())["pose"]
            expect(page.locator("#measurements .value")).to_contain_text(f"(before: {before})", timeout=PATIENCE_MS)
            value, low, high = numbers(value_of(page))
            assert low < 12.0 < high
            assert abs(value - 12.0) < 0.15
            _, *words = shlex.split(copied(page, "command"))
            assert run_aerodft(*words, "--json").json[0]["value"] == pytest.approx(value, abs=0.01)
            level = value_of(page)
            page.fill("#heights", "@corner-1; 0.5")  # a landmark's own height, and one that is typed
            page.press("#heights", "Tab")
            expect(page.locator("#measurements .value")).not_to_have_text(level, timeout=PATIENCE_MS)
            page.wait_for_function("() => document.querySelector('#copies').ariaBusy === 'false'")
            assert "elevation=0.0,0.5" in copied(page, "command")
            first, second = tomllib.loads(copied(page, "probe"))["probe"][0]["pixels"]
            assert (first.endswith("@corner-1"), len(second)) == (True, 2)
            page.fill("#heights", "@nobody; 0.5")
            page.press("#heights", "Tab")
            said = "got @nobody, expected one of corner-0, corner-1, corner-2, corner-3"
            expect(page.locator("#measurements .value")).to_contain_text(said, timeout=PATIENCE_MS)


def test_a_camera_is_calibrated_from_heights_lengths_and_a_vertical(browser, without_pose):
    known = [("height", 3, [(x, y, z) for z in (0.0, 3.0)]) for x, y in ((2.0, 18.0), (-9.0, 26.0), (9.0, 26.0))]
    known += [("length", 12, [(x, y, 0.0) for x in (-6.0, 6.0)]) for y in (14.0, 40.0)]
    known += [("vertical", None, [(-8.0, 22.0, z) for z in (0.0, 5.0)])]
    for page in shown(browser, without_pose):
        expect(page.locator("[data-kind=width]")).to_be_disabled()  # there is nothing to measure with yet
        for kind, metres, points in known:
            page.select_option("#evidence", kind)
            for point in points:
                click(page, seen(*point))
            if metres:
                page.keyboard.type(str(metres))
                assert page.inner_text("#solved").startswith("Enter or Tab")
                page.keyboard.press("Tab")
                assert "metres of" in page.evaluate("document.activeElement.ariaLabel")
        expect(page.locator("#parameters")).to_contain_text("tilt", timeout=PATIENCE_MS)
        page.click("#use", timeout=PATIENCE_MS)
        expect(page.locator("#solved")).to_contain_text("Saved as", timeout=PATIENCE_MS)
        page.click("[data-kind=width]")
        for x_m in (-6.0, 6.0):
            click(page, seen(x_m, 22.0))
        _, low, high = numbers(value_of(page))
        assert low < 12.0 < high


def test_landmarks_are_read_from_a_list_of_ground_control_points(browser, without_pose):
    places = [(-6.0, 15.0), (-6.0, 45.0), (6.0, 45.0), (6.0, 15.0)]
    lines = []
    for row, (x, y) in enumerate(places):
        u, v = seen(x, y)
        lines.append(f"{500_000 + x} {5_200_000 + y} 0 {u:.2f} {v:.2f} river.png gcp-{row}")
    for page in shown(browser, without_pose):
        page.click("[data-kind=landmark]")
        page.click("#landmarks summary")
        page.fill("#list", "\n".join(["EPSG:32633", *lines]))
        page.click("#take")
        expect(page.locator("#places tr[data-item]")).to_have_count(4, timeout=PATIENCE_MS)
        expect(page.locator("#parameters")).to_contain_text("tilt50.0", timeout=PATIENCE_MS)
        page.click("[aria-label='Delete gcp-1']")
        expect(page.locator("#places tr[data-item]")).to_have_count(3)
        page.click("#undo")  # takes the deletion back, and nothing else
        expect(page.locator("[aria-label^='Delete gcp-']")).to_have_count(4)
        expect(page.locator("#parameters")).to_contain_text("tilt50.0", timeout=PATIENCE_MS)
        page.fill("[aria-label='Standard deviation in metres of gcp-0']", "0.5")
        page.fill("[aria-label='east of gcp-2']", "500400")
        page.keyboard.press("Enter")
        assert page.evaluate("document.activeElement.id") == "image"  # for the next mark
        expect(page.locator("#solved")).to_contain_text("Not found yet", timeout=PATIENCE_MS)
        assert not re.search(r"[`_\[]|/tmp", page.inner_text("#solved"))  # in the page's words
        page.click("#landmarks summary")
        page.locator("#list").evaluate(
            "(list, text) => { list.value = text; }", "name,x,y,z,u,v\n" + 9000 * "a,1,2,3\n"
        )
        page.click("#take")
        expect(page.locator("#solved")).to_contain_text("too much at once: 82 kB")
        expect(page.locator("#link")).to_have_text("connected")


def test_it_is_reached_by_keys_alone(page):
    page.focus("#image")
    page.keyboard.press("p")
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    before = value_of(page)
    assert "ahead" in before
    page.keyboard.press("Enter")  # picks it up
    for _ in range(5):
        page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Enter")
    expect(page.locator("#measurements .value")).not_to_have_text(before, timeout=PATIENCE_MS)
    page.keyboard.press("Control+z")
    expect(page.locator("#measurements .value")).to_have_text(before, timeout=PATIENCE_MS)
    page.keyboard.press("Delete")
    expect(page.locator("#measurements li")).to_have_count(0)


def test_a_phone_shows_the_image_at_its_full_width_and_is_used_by_fingers(browser, address):
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(address)
    page.wait_for_selector("body[data-ready]", timeout=PATIENCE_MS)
    box = page.locator("#image").bounding_box()
    assert box["width"] == 390
    assert abs(box["height"] - 390 * SIZE[1] / SIZE[0]) < 2
    for x_m in (-6.0, 6.0):
        page.touchscreen.tap(*place(page, seen(x_m, 30.0)))
    value, _, _ = numbers(value_of(page))
    assert abs(value - 12.0) < 0.5  # a finger's pixel is 2.5 of the image
    buttons = page.locator("button:visible, select:visible")
    sizes = buttons.evaluate_all("(all) => all.map((each) => each.offsetHeight)")
    assert min(sizes) >= 44
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    context.close()
