"""``plot`` and ``report``: files that open, pages that need nothing else, and refusals in a sentence."""

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import orjson
import pytest

RECORDING = Path("tests/cli/frozen-0.1")
MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
ADDRESS = re.compile(
    r"(?i)\b(https?|ftp|rtsp|udp\w*|tcp|file|ws|wss)\s*:\s*/|\burl\s*\((?!#)|@import|//[a-z0-9-]+\.[a-z]"
)


class Page(HTMLParser):
    """Elements and text of a page; every element is closed."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.words, self._open = [], [], []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in {"meta", "img"}:
            self._open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def page_of(path):
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def check_stands_alone(text, page):
    """Nothing in it is loaded from anywhere, and browsers are told to load nothing."""
    assert ADDRESS.findall(re.sub(r"data:image/(png|jpeg);base64,[A-Za-z0-9+/=]*", "", text)) == []
    assert not {"script", "link", "iframe", "object", "embed", "base", "form"} & {tag for tag, _ in page.elements}
    for _, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "data", "action", "poster", "srcset"):
            assert (attributes.get(name) or "#").startswith(("data:image/", "#"))
    policy = next(each["content"] for tag, each in page.elements if tag == "meta" and "http-equiv" in each)
    assert policy.startswith("default-src 'none'")
    assert "@media print" in text


@pytest.mark.parametrize("suffix", MAGIC)
def test_a_recording_is_plotted(aerodft, tmp_path, suffix):
    done = aerodft("plot", RECORDING, "--probe", "width-a", "--probe", "near", "-o", tmp_path / f"x{suffix}")
    assert (done.code, done.out) == (0, b"")
    assert "near, width-a" in done.err
    data = (tmp_path / f"x{suffix}").read_bytes()
    assert data.startswith(MAGIC[suffix])
    assert aerodft("plot", RECORDING, "--probe", "width-a", "--probe", "near", "-o", tmp_path / f"y{suffix}").code == 0
    assert (tmp_path / f"y{suffix}").read_bytes() == data


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("x.gif", (), "got .gif, expected .pdf or .png or .svg"),
        ("x.png", ("--probe", "bridge"), "got bridge, expected of centre, field, near, width-b, width-a"),
    ],
)
def test_what_cannot_be_plotted_is_one_sentence(aerodft, tmp_path, name, options, said):
    done = aerodft("plot", RECORDING, *options, "-o", tmp_path / name)
    assert (done.code, said in done.last, list(tmp_path.iterdir())) == (2, True, []), done.err


@pytest.mark.parametrize(("command", "name"), [("plot", "x.svg"), ("report", "x.html")])
def test_nothing_is_replaced_unless_asked(aerodft, tmp_path, command, name):
    target = tmp_path / name
    target.write_text("mine")
    refused = aerodft(command, RECORDING, "-o", target)
    assert (refused.code, target.read_text()) == (3, "mine")
    assert "the file exists" in refused.last
    assert aerodft(command, RECORDING, "-o", target, "--overwrite").code == 0
    assert aerodft(command, tmp_path / "none", "-o", tmp_path / f"y{name}").code == 3


def test_a_page_is_no_pdf(aerodft, tmp_path):
    done = aerodft("report", RECORDING, "-o", tmp_path / "x.pdf")
    assert (done.code, list(tmp_path.iterdir())) == (2, [])
    assert "x.pdf: the name says another format: got .pdf, expected .html" in done.last


def test_a_page_says_what_was_measured_and_of_what(aerodft, tmp_path):
    assert aerodft("report", RECORDING, "-o", tmp_path / "x.html").code == 0
    text, page = page_of(tmp_path / "x.html")
    check_stands_alone(text, page)
    rows = [orjson.loads(line) for line in aerodft("export", RECORDING, "--format", "jsonl").out.splitlines()]
    for name in {row["name"] for row in rows}:
        own = [row for row in rows if row["name"] == name]
        values = [row["value"] for row in own if row["value"] is not None]
        answered = sum(row["status"] == "ok" for row in own)
        assert re.search(rf"{name} (position|area|range|distance) {answered} of {len(own)}", page.text)
        if values:
            shown = float(re.search(rf"{name} \w+ {answered} of {len(own)} ([\d.]+)", page.text)[1])
            assert shown == pytest.approx(np.median(values), rel=0.02)
        places = [row["enu_m"][0][:2] for row in own if row["kind"] == "position" and row["status"] == "ok"]
        for centre, axis in zip(np.median(places, axis=0) if places else (), ("east", "north"), strict=False):
            about = rf"{name} position {answered} of {len(own)} (\S+) \S+ \S+ to \S+ m {axis} of the origin"
            assert float(re.search(about, page.text)[1]) == pytest.approx(centre, abs=0.05)
    for file in RECORDING.iterdir():
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    assert "Measured by aerodft 0.1.0 (118 measurements)." in page.text
    stated, _, assumed = page.text.partition("Assumed: defaults of the software")
    assert "telemetry.height.order home" in stated
    assert "telemetry.attitude.lag_s 0.3" in assumed
    assert "95 of 100 cases" in page.text
    pictures = [each["src"] for tag, each in page.elements if tag == "img"]
    assert base64.b64decode(pictures[0].partition(",")[2]).startswith(b"\xff\xd8")
    assert sum(tag == "svg" for tag, _ in page.elements) == 2


@pytest.mark.parametrize(("command", "name"), [("plot", "x.svg"), ("report", "x.html")])
def test_what_is_not_whole_is_said(aerodft, tmp_path, command, name):
    folder = tmp_path / "r"
    folder.mkdir()
    for file in RECORDING.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    data = bytearray((folder / "data_000.mcap").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    (folder / "data_000.mcap").write_bytes(data)
    done = aerodft(command, folder, "-o", tmp_path / name)
    assert (done.code, (tmp_path / name).exists()) == (5, True)
    assert "without 1 damaged chunk" in done.last
    assert command == "plot" or "without 1 damaged chunk" in (tmp_path / name).read_text()


def test_addresses_of_the_station_stay_out_of_the_page(aerodft, tmp_path):
    folder = tmp_path / "r"
    folder.mkdir()
    for file in RECORDING.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    config = (folder / "config.toml").read_text().replace('name = "simulated 320x180"', 'name = "<b>mine</b>"')
    config = config.replace('video = "video.mp4"\nstart = "2026-11-21T00:34:38Z"', 'stream = "rtsp://me:secret@cam/1"')
    (folder / "config.toml").write_text(config)
    assert aerodft("report", folder, "-o", tmp_path / "x.html").code == 0
    text, page = page_of(tmp_path / "x.html")
    check_stands_alone(text, page)
    assert "secret" not in text
    assert "camera.name <b>mine</b>" in page.text


def test_a_river_is_a_page(aerodft, tmp_path):
    image, camera = "configs/calibration/bridge.jpg", "configs/cameras/demo-1080p.toml"
    pose = ("--height", 7.93, "--tilt", 62.3, "--roll", -0.6, "--seed", "960,150", "--spacing", 3)
    assert aerodft("river", image, "--camera", camera, *pose, "-o", tmp_path / "reach").code == 0
    assert aerodft("report", tmp_path / "reach", "-o", tmp_path / "x.html").code == 0
    text, page = page_of(tmp_path / "x.html")
    check_stands_alone(text, page)
    result = orjson.loads((tmp_path / "reach/result.json").read_bytes())
    said = re.search(r"river is ([\d.]+) m wide .*? ([\d.]+) to ([\d.]+) m \(95 %\)", page.text)
    median = result["width_m"]["median"]
    np.testing.assert_allclose([float(each) for each in said.groups()], [median, *result["width_m"]["ci95"]], rtol=0.02)
    assert base64.b64encode((tmp_path / "reach/plate.png").read_bytes()).decode() in text
    assert "nobody said" in page.text
    for reason in result["reasons"]:
        assert " ".join(reason.split()) in page.text
    for file in (tmp_path / "reach").iterdir():
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    (tmp_path / "reach/result.json").write_text("{}")
    damaged = aerodft("report", tmp_path / "reach", "-o", tmp_path / "y.html")
    assert (damaged.code, (tmp_path / "y.html").exists()) == (3, False)
