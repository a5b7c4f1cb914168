"""GoPro's GPMF: against the published samples' first values, and payloads that a small writer makes."""

import math
import random
import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest

from aerodft.adapters.telemetry import CompositeDecoder, carries_telemetry, open_log
from aerodft.errors import InputError
from aerodft.model import PositionTrack, RawBlock, VehicleTrack
from replay.recordings import Recording
from tests.adapters.telemetry import gpmf_writer as w
from tests.commands import run_aerodft
from tests.nights import at_night

START = datetime(2026, 5, 1, 10, 0, 0, 250_000, tzinfo=UTC)
START_NS = round(START.timestamp() * 1e6) * 1000
LAT, LON, RATE = 47.1234567, -8.7654321, 10


def place(second: float) -> tuple[float, float, float]:
    return LAT + second * 4e-5, LON, 412.0


def payloads(seconds: int = 6, fix: int = 3, *, own_times: bool = False) -> list[bytes]:
    made = []
    for k in range(seconds):
        at, places = START + timedelta(seconds=k), [place(k + j / RATE) for j in range(RATE)]
        made.append(w.gps9(at, places, 1 / RATE, fix) if own_times else w.gps5(at, places, fix))
    return made


def tracks_of(path: Path, kind: type[Any]) -> tuple[dict[str, Any], dict[str, int], tuple[str, ...]]:
    source, decoder = open_log(path), CompositeDecoder()
    found = []
    for block in source.events():
        assert isinstance(block, RawBlock)
        found += [track for track in decoder.decode(block) if isinstance(track, kind)]
    names = found[0].__dataclass_fields__ if found else ()
    columns = {name: getattr(found[0], name) for name in names}
    return columns, dict(decoder.rejected), source.warnings()


@pytest.mark.parametrize(
    ("name", "count", "lat_deg", "lon_deg", "utc"),
    [
        ("hero5.raw", 18, 33.1264969, -117.3273542, "2017-04-17T17:31:03+00:00"),
        ("Fusion.raw", 19, 33.1266299, -117.3274386, "2018-03-23T17:25:37.375+00:00"),
    ],
)
def test_first_places_of_public_samples(
    data_folder: Path, name: str, count: int, lat_deg: float, lon_deg: float, utc: str
) -> None:
    path = data_folder / "flights/other" / name
    if not path.exists():
        pytest.skip("no flights in the data folder")
    found, rejected, said = tracks_of(path, PositionTrack)
    assert not rejected
    assert len(found["lat_rad"]) == count
    assert math.degrees(found["lat_rad"][0]) == pytest.approx(lat_deg, abs=5e-8)
    assert math.degrees(found["lon_rad"][0]) == pytest.approx(lon_deg, abs=5e-8)
    assert found["arrival_ns"][0] == round(datetime.fromisoformat(utc).timestamp() * 1000) * 1_000_000
    assert np.isnan(found["alt_msl_m"]).all()  # -20 m on the coast: not above the sea
    assert any("no height" in each for each in said)
    assert any("no camera angles" in each for each in said)


@pytest.mark.parametrize("own_times", [False, True])
@pytest.mark.parametrize("in_video", [False, True])
def test_places_and_times_are_those_written(tmp_path: Path, *, own_times: bool, in_video: bool) -> None:
    path, made = tmp_path / "clip.mp4", payloads(own_times=own_times)
    if in_video:
        w.video(path, made)
    else:
        path.write_bytes(b"".join(made))
    assert carries_telemetry(path) == in_video
    found, rejected, _ = tracks_of(path, PositionTrack)
    assert not rejected
    seconds = np.arange(6 * RATE) / RATE
    np.testing.assert_allclose(found["arrival_ns"], START_NS + seconds * 1e9, atol=2e6)
    np.testing.assert_allclose(np.degrees(found["lat_rad"]), LAT + seconds * 4e-5, atol=6e-8)
    np.testing.assert_allclose(np.degrees(found["lon_rad"]), LON, atol=6e-8)
    np.testing.assert_allclose(found["std_m"], 7.5)  # 5 m per unit of dilution
    assert np.all(tracks_of(path, VehicleTrack)[0]["heading_std_rad"] == math.pi)  # no heading is read


def test_a_clip_with_stated_height_and_tilt_is_measured(tmp_path: Path) -> None:
    video = tmp_path / "clip.mp4"
    w.video(video, payloads(8))
    (tmp_path / "station.toml").write_text(
        '[station]\nname = "s"\n[camera]\nname = "c"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n'
        '[telemetry.height]\norder = ["manual"]\nmanual_m = 30.0\n'
        '[[probe]]\nname = "p"\nkind = "position"\npixels = [[31.5, 23.5]]\n'
    )
    args = ["--config", tmp_path / "station.toml", "-o", tmp_path / "rec"]
    refused = run_aerodft("import", video, *args)
    assert refused.code == 4, refused.err
    assert "camera attitude" in refused.last
    done = run_aerodft("import", video, *args, "--tilt", "0")
    assert done.code == 0, done.err
    found = [orjson.loads(each) for each in Recording(tmp_path / "rec").measurements()]
    good = [each for each in found if each["status"] == "ok"]
    assert len(good) > 25
    for each in good:
        second = (int(each["stamp_ns"]) - START_NS) / 1e9
        assert each["geo"][0]["lat_deg"] == pytest.approx(place(second)[0], abs=2e-6)
        assert each["pose"]["height_source"] == "manual"


def test_without_a_fix_there_is_no_place(tmp_path: Path) -> None:
    path = tmp_path / "clip.raw"
    path.write_bytes(b"".join([*payloads(2, fix=0), *payloads(3)[2:]]))
    found, _, said = tracks_of(path, PositionTrack)
    assert len(found["lat_rad"]) == RATE
    assert any("no GPS fix in 2 of 3 payloads" in each for each in said)
    for own_times in (False, True):
        path.write_bytes(b"".join(payloads(2, fix=0, own_times=own_times)))
        with pytest.raises(InputError, match="GPS that had no fix"):
            open_log(path)


def test_metadata_without_gps_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "clip.raw"
    path.write_bytes(w.nest("DEVC", w.nest("STRM", w.item("ACCL", "s", 6, 1, struct.pack(">3h", 1, 2, 3)))))
    with pytest.raises(InputError, match="without GPS5 or GPS9"):
        open_log(path)


@pytest.mark.parametrize("first", [0, *at_night(*range(200, 2000, 200))])
def test_mutated_files_raise_nothing(tmp_path: Path, first: int) -> None:
    path = tmp_path / "clip.raw"
    for seed in range(first, first + 200):
        draw = random.Random(seed)  # noqa: S311
        data = bytearray(b"".join(payloads(3, own_times=seed % 2 == 0)))
        for _ in range(draw.randrange(1, 12)):
            kind, at = draw.randrange(3), draw.randrange(len(data))
            if kind == 0:
                data[at] = draw.randrange(256)
            elif kind == 1:
                del data[at : at + draw.randrange(1, 40)]
            else:
                data[at:at] = bytes(draw.randrange(256) for _ in range(draw.randrange(1, 20)))
        path.write_bytes(data)
        try:
            source = open_log(path)
        except InputError:
            continue
        decoder = CompositeDecoder()
        for block in source.events():
            assert isinstance(block, RawBlock)
            for track in decoder.decode(block):
                if isinstance(track, PositionTrack):
                    assert np.all(np.abs(track.lat_rad) <= math.pi / 2)
                    assert np.all(np.abs(track.lon_rad) <= math.pi)
