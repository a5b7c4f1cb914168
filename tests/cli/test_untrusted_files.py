"""Files that nobody vouches for: each ends in one sentence, fetches nothing, and holds nobody up."""

import json
import os
import struct
import zlib
from pathlib import Path

import pytest

from aerodft.adapters.files import cell_text, csv_cell
from aerodft.cli.output import print_json, say

VRT = """<VRTDataset rasterXSize="2" rasterYSize="2"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>
<SourceFilename relativeToVRT="0">/vsicurl/http://127.0.0.1:9/x.tif</SourceFilename><SourceBand>1</SourceBand>
</SimpleSource></VRTRasterBand></VRTDataset>"""


def png(path: Path, width: int, height: int) -> Path:
    """A PNG file whose header claims a size, and that has no pixels."""
    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = b"".join(struct.pack(">I", len(each) - 4) + each + struct.pack(">I", zlib.crc32(each)) for each in (
        head, b"IDAT" + zlib.compress(b""), b"IEND",
    ))  # fmt: skip
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
    return path


@pytest.mark.parametrize("name", ["dem.vrt", "dem.tif"])
def test_an_elevation_model_is_a_geotiff_whatever_its_name(aerodft, desk, tmp_path: Path, name: str) -> None:
    pytest.importorskip("rasterio")
    (tmp_path / name).write_text(VRT)
    text = desk.config.read_text().replace('name = "test"', 'name = "test"\norigin = { lat_deg = 1, lon_deg = 2 }')
    config = desk.station(text + f'[ground]\nterrain = "{tmp_path / name}"\n')
    done = aerodft("import", desk.log, "-c", config, "-o", tmp_path / "r")
    assert done.code == 3
    assert "expected a GeoTIFF" in done.last


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"x = {'9' * 5000}", "too many digits"),
        (f"x = 0x{'f' * 5000}", "too large"),
        ("[telemetry.attitude]\nslew_dps = 1e-300", "at least 0.01"),
    ],
)
def test_numbers_that_no_configuration_has_are_one_sentence(
    aerodft, desk, tmp_path: Path, line: str, said: str
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(f"{desk.config.read_text()}\n{line}\n")
    done = aerodft("import", desk.log, "-c", path, "-o", tmp_path / "r")
    assert done.code == 3
    assert said in done.last, done.last
    assert len(done.err.splitlines()) == 1


def test_an_image_whose_header_claims_more_than_memory_is_one_sentence(aerodft, desk, tmp_path: Path) -> None:
    image = png(tmp_path / "huge.png", 50_000, 50_000)
    for words in (
        ("calibrate-lens", image, "--board", "9x6", "--square", "0.03"),
        ("import", desk.log, "-c", desk.config, "--images", tmp_path, "-o", tmp_path / "r"),
    ):
        done = aerodft(*words)
        assert done.code in {2, 3, 4}, words
        assert "Traceback" not in done.err


@pytest.mark.parametrize("command", ["config", "log", "observations", "camera"])
def test_a_pipe_is_refused_and_nobody_waits(aerodft, desk, tmp_path: Path, command: str) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    words = {
        "config": ("import", desk.log, "-c", pipe, "-o", tmp_path / "r"),
        "log": ("import", pipe, "-c", desk.config, "-o", tmp_path / "r"),
        "observations": ("import", desk.log, "-c", desk.config, "--observations", pipe, "-o", tmp_path / "r"),
        "camera": ("measure", "--camera", pipe, "--height", "10", "--tilt", "30", "--probe", "range 1,1"),
    }
    done = aerodft(*words[command])
    assert done.code in {2, 3}
    assert len(done.err.splitlines()) == 1, done.err


@pytest.mark.usefixtures("desk")
def test_a_file_larger_than_memory_and_a_name_too_long_are_one_sentence(aerodft, tmp_path: Path) -> None:
    camera = ("measure", "--camera", tmp_path / "camera.toml", "--height", 40, "--tilt", 30, "--probe", "range 31,40")
    with (tmp_path / "endless").open("wb") as file:
        file.truncate(1 << 40)
    for words in (
        (*camera, "--covariance", tmp_path / "endless"),
        ("river", tmp_path / "endless", *camera[1:-2]),
        ("measure", "--recording", "a" * 300, "--at", 3, *camera[-2:]),
        (*camera, "--lat", 1, "--lon", 2, "--terrain", "a" * 300),
    ):
        done = aerodft(*words)
        assert done.code == 3, (words, done.err)
        assert len(done.err.splitlines()) == 1, done.err


@pytest.mark.parametrize("name", ["a.txt", "a.json", "a.xlsx", "a.shp", "a.csv.gz"])
def test_an_ending_that_is_not_written_is_refused(aerodft, tmp_path: Path, name: str) -> None:
    done = aerodft("export", "tests/cli/frozen-0.1", "-o", tmp_path / name)
    assert (done.code, list(tmp_path.iterdir())) == (2, [])


def test_cells_are_no_formulas_and_hold_no_control_characters() -> None:
    for text in ("=1+1", "+1", "-1", "@x", "=cmd|' /C calc'!A0"):
        assert csv_cell(text) == f"'{text}"
        assert cell_text(f"'{text}") == text
    assert csv_cell("\x1b[31mred") == "\\x1b[31mred"
    assert [csv_cell(-1.5), csv_cell("left"), csv_cell(None)] == [-1.5, "left", None]


def test_control_characters_do_not_reach_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "a\x9b31m\u202e\U000e0001"
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    print_json({"name": name})
    printed = capsys.readouterr().out
    assert printed.isascii()
    assert json.loads(printed) == {"name": name}
    say("a\x1b]0;title\x07b\nnext \x9b31m")
    assert capsys.readouterr().err == "a\\x1b]0;title\\x07b\nnext \\x9b31m\n"
