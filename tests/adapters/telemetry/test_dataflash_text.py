"""ArduPilot's text logs: the same telemetry and measurements as the .bin log that the text was made from."""

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.errors import InputError
from aerodft.model import ClockTrack, GimbalTrack, HeightTrack, PositionTrack, RawBlock, Track, VehicleTrack
from tests.adapters.telemetry.text_log_writer import text_of
from tests.commands import run_aerodft
from tests.nights import at_night

SMALL = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 129, 23, ATT, Qfff, TimeUS,Roll,Pitch,Yaw
FMT, 130, 26, GPS, QBIHLL, TimeUS,Status,GMS,GWk,Lat,Lng
FMT, 131, 75, MSG, QZ, TimeUS,Message
FMT, 132, 12, MODE, QM, TimeUS,Mode
ATT, 1000000, 1.5, -2.25, 359.5
MSG, 1000100, one, two, three
MODE, 1000200, LOITER
GPS, 1100000, 3, 345600000, 2300, 47.1234567, -8.7654321
ATT, 1200000, 1.25, -2.5, 0.5
"""


SHARE = 4  # of the log that is compared: all of it takes a minute


@pytest.fixture(scope="module")
def cut_log(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    whole = data_folder / "sitl/brushless_cut.BIN"
    if not whole.exists():
        pytest.skip("no SITL logs in the data folder")
    path = tmp_path_factory.mktemp("binary") / "flight.bin"
    data = whole.read_bytes()
    path.write_bytes(data[: len(data) // SHARE])
    return path


@pytest.fixture(scope="module")
def text_log(cut_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("text") / "flight.log"
    path.write_text(text_of(cut_log))
    return path


def tracks_of(path: Path) -> tuple[dict[tuple[type[Track], str], dict[str, Any]], tuple[str, ...]]:
    source, decoder = open_log(path), CompositeDecoder()
    parts: dict[tuple[type[Track], str], list[Track]] = {}
    for block in source.events():
        assert isinstance(block, RawBlock)
        for track in decoder.decode(block):
            parts.setdefault((type(track), str(getattr(track, "source", ""))), []).append(track)
    joined: dict[tuple[type[Track], str], dict[str, Any]] = {}
    for key, tracks in parts.items():
        columns = {name: [getattr(track, name) for track in tracks] for name in key[0].__dataclass_fields__}
        joined[key] = {name: np.concatenate(v) for name, v in columns.items() if isinstance(v[0], np.ndarray)}
    return joined, source.warnings()


def test_telemetry_is_that_of_the_binary_log(cut_log: Path, text_log: Path) -> None:
    binary, _ = tracks_of(cut_log)
    text, said = tracks_of(text_log)
    assert not said
    assert text.keys() == binary.keys()
    assert {kind for kind, _ in text} >= {ClockTrack, VehicleTrack, PositionTrack, HeightTrack, GimbalTrack}
    for key, columns in binary.items():
        for name, values in columns.items():
            found = text[key][name]
            if values.dtype.kind == "f":
                np.testing.assert_allclose(found, values, rtol=1e-7, atol=1e-6, err_msg=f"{key} {name}")
            else:
                np.testing.assert_array_equal(found, values, err_msg=f"{key} {name}")


def test_doctor_lists_the_same_messages(cut_log: Path, text_log: Path) -> None:
    def streams(path: Path) -> dict[str, int]:
        done = run_aerodft("doctor", path, "--json")
        return {each["message"]: each["count"] for each in done.json["streams"]}

    assert streams(text_log) == streams(cut_log)


@pytest.mark.parametrize("delimiter", [", ", ","])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_lines_by_hand(tmp_path: Path, delimiter: str, ending: str) -> None:
    path = tmp_path / "small.log"
    path.write_bytes(("\ufeff" + SMALL.replace(", ", delimiter).replace("\n", ending)).encode())
    tracks, said = tracks_of(path)
    assert not said
    vehicle = tracks[VehicleTrack, ""]
    assert vehicle["boot_ns"].tolist() == [1_000_000_000, 1_200_000_000]
    clock = tracks[ClockTrack, ""]
    # GPS week 2300 begins 2024-02-04; 345,600 s are four days, less 18 leap seconds: computed by hand.
    assert clock["unix_ns"].tolist() == [(1_707_004_800 + 345_600 - 18) * 10**9]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("ATT, 1300000, 1.5, -2.25", "another number of columns"),
        ("ATT, 1300000, 1.5, x, 2", "none of its type"),
        ("GPS, 1300000, 3, 345600000, 99999999, 47.0, -8.0", "none of its type"),
        ("GPS, 1300000, 3, 345600000, 2300, 447.0, -8.0", "none of its type"),
        ("XYZ, 1300000, 3", "no FMT line declares"),
        ("FMT, 133, 3, ABC, Qf, TimeUS,A", "contradicts itself"),
        ("ATT, 1300000, 1.5, -2.", "another number of columns"),  # cut off
    ],
)
def test_lines_that_cannot_be_are_left_out_and_said(tmp_path: Path, line: str, why: str) -> None:
    path = tmp_path / "small.log"
    path.write_text(SMALL + line + "\n")
    tracks, said = tracks_of(path)
    assert len(tracks[VehicleTrack, ""]["boot_ns"]) == 2
    assert any("1 lines left out" in each and why in each for each in said)


@pytest.mark.parametrize("text", ["FMT, 128, 89, FMT, BBnNZ\nnothing\n", "FMT, 300, 89, FMT, B, Type\nATT, 1, 2\n"])
def test_what_declares_nothing_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "no.log"
    path.write_text(text)
    with pytest.raises(InputError):
        open_log(path)


@pytest.mark.parametrize("first", [0, *at_night(*range(100, 1000, 100))])
def test_mutated_files_raise_nothing(tmp_path: Path, first: int) -> None:
    whole = (SMALL + "".join(f"ATT, {1_300_000 + 100_000 * k}, 1.0, 2.0, {k}\n" for k in range(20))).encode()
    for seed in range(first, first + 100):
        draw, data = random.Random(seed), bytearray(whole)  # noqa: S311
        for _ in range(draw.randrange(1, 12)):
            kind, at = draw.randrange(4), draw.randrange(len(data))
            if kind == 0:
                data[at] = draw.randrange(256)
            elif kind == 1:
                del data[at : at + draw.randrange(1, 40)]
            elif kind == 2:
                data[at:at] = draw.choice([b"\n", b"\n\n", b",", b"nan", b"1e400", b"\xef\xbb\xbf", b"-"])
            else:
                data[at:at] = data[at : at + draw.randrange(1, 100)]
        path = tmp_path / "mutated.log"
        path.write_bytes(data)
        try:
            tracks, _ = tracks_of(path)
        except InputError:
            continue
        for (kind_of, _), columns in tracks.items():
            if kind_of is VehicleTrack:
                assert np.isfinite(columns["wxyz"]).all()
