"""The page of a station that measures: a real stream and telemetry in, images and numbers in a browser out."""

import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from playwright.sync_api import expect

from aerodft.adapters.config.camera import camera_document
from aerodft.sim import default_camera
from tests.commands import run_aerodft
from tests.ports import free_endpoint, free_udp_port
from tests.web.pages import PATIENCE_MS, copied, needs_browser, opened_service, shown, shown_measurement, value_of

SIZE = (640, 360)

pytestmark = needs_browser


@dataclass
class Field:
    """Where a station listens, and its files."""

    folder: Path
    mavlink: int
    video: int
    bus: str

    def fly(self, seconds):
        """A simulated flight, as a process."""
        command = [sys.executable, "-m", "aerodft.sim", "--live", "--duration", seconds, "--fps", 8]
        command += ["--out", self.folder / "flight", "--camera", self.folder / "camera.toml"]
        command += ["--mavlink", f"udpout:127.0.0.1:{self.mavlink}", "--video", f"udp://127.0.0.1:{self.video}"]
        command += ["--zenoh", self.bus, "--station", "live"]
        return subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture
def field(tmp_path):
    where = Field(tmp_path, free_udp_port(), free_udp_port(), free_endpoint())
    width, height = SIZE
    (tmp_path / "camera.toml").write_text(tomli_w.dumps(camera_document(default_camera(width, height))))
    across = [[0.3 * width, 0.6 * height], [0.7 * width, 0.6 * height]]
    station = {
        "station": {"name": "live"},
        "camera": {"file": "camera.toml"},
        "zenoh": {"listen": where.bus},
        "telemetry": {"connection": f"udpin:127.0.0.1:{where.mavlink}", "height": {"order": ["home"]}},
        "images": {"stream": f"udp://127.0.0.1:{where.video}"},
        "probe": [{"name": "across", "kind": "width", "pixels": across}],
    }
    (tmp_path / "station.toml").write_text(tomli_w.dumps(station))
    return where


def test_a_station_is_measured_in_while_it_measures(browser, field):
    recording, station = field.folder / "recording", field.folder / "station.toml"
    with opened_service(station, "-o", recording) as address:
        flight = field.fly(12)
        for page in shown(browser, address):
            expect(page.locator("#pose")).to_contain_text("Height", timeout=PATIENCE_MS)
            page.wait_for_timeout(7000)
            page.click("#play")
            stopped = page.inner_text("#when")
            click_twice(page)
            value = value_of(page)
            page.wait_for_timeout(1000)
            assert "stopped at image" in page.inner_text("#when") != stopped  # the station goes on
            words = shlex.split(copied(page, "command"))[1:]
            page.click("[data-save=fixed]")
            expect(page.locator("#saved")).to_contain_text("next start", timeout=PATIENCE_MS)
            page.click("#play")
            expect(page.locator("#when")).not_to_contain_text("stopped", timeout=PATIENCE_MS)
            flight.wait(60)
            alerts = page.locator("#alerts")
            expect(alerts).to_contain_text("the autopilot has not been heard for", timeout=PATIENCE_MS)
            count = alerts.locator("p").count()
            alerts.locator("button").first.click()
            expect(alerts.locator("p")).to_have_count(count - 1)
    assert value == shown_measurement(run_aerodft(*words, "--json").json[0])
    saved = tomllib.loads(station.read_text())["probe"]
    assert [each["name"] for each in saved] == ["across", "width-1"]


def test_a_fixed_camera_is_lost_and_found_again_and_calibrated_in_its_live_image(browser, field):
    station = field.folder / "station.toml"
    tables = tomllib.loads(station.read_text())
    del tables["telemetry"]
    station.write_text(tomli_w.dumps(tables | {"pose": {"height_agl_m": 9.0, "tilt_deg": 60.0}}))
    with opened_service(station, "-o", field.folder / "first") as address:
        port = address.rstrip("/").rpartition(":")[2]
        page = browser.new_context().new_page()
        page.goto(address)
        expect(page.locator("#link")).to_have_text("connected", timeout=PATIENCE_MS)
    expect(page.locator("#link")).to_contain_text("lost", timeout=PATIENCE_MS)
    with opened_service(station, "-o", field.folder / "second", "--port", port):
        expect(page.locator("#link")).to_have_text("connected", timeout=PATIENCE_MS)
        flight = field.fly(5)
        expect(page.locator("#pose")).to_contain_text("Height 9.0", timeout=PATIENCE_MS)
        flight.wait(60)
        page.click("[data-kind=landmark]")
        expect(page.locator("#when")).to_contain_text("stopped at image", timeout=PATIENCE_MS)
        page.click("#landmarks summary")
        page.fill("#list", "\n".join(["EPSG:32633", *control_points(default_camera(*SIZE))]))
        page.click("#take")
        page.click("#use", timeout=PATIENCE_MS)
        expect(page.locator("#solved")).to_contain_text("Saved as", timeout=PATIENCE_MS)
        expect(page.locator("#pose")).to_contain_text(re.compile(r"Height 1(1\.9|2\.0)"), timeout=PATIENCE_MS)
        page.click("[data-kind=width]")
        click_twice(page)
        value, words = value_of(page), shlex.split(copied(page, "command"))[1:]
    page.context.close()
    assert value == shown_measurement(run_aerodft(*words, "--json").json[0])


def control_points(camera):
    """Lines of OpenDroneMap's list: points of level ground by a pinhole 12 m above it, tilted by 50 degrees."""
    tilt = np.radians(50.0)
    axes = np.array([[1.0, 0.0, 0.0], [0.0, -np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), -np.cos(tilt)]])
    places = np.array([(x, y, 0.0) for x in (-5.0, 0.0, 5.0) for y in (9.0, 14.0, 22.0)])
    rays = (places - [0.0, 0.0, 12.0]) @ axes.T
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera_matrix(camera), np.array(camera.distortion))
    for row, ((x, y, _), (u, v)) in enumerate(zip(places, pixels[:, 0], strict=True)):
        yield f"{500_000 + x} {5_200_000 + y} 0 {u:.2f} {v:.2f} live.png gcp-{row}"


def camera_matrix(camera):
    return np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])


def click_twice(page):
    box = page.locator("#image").bounding_box()
    for share in (0.4, 0.6):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.6 * box["height"])
