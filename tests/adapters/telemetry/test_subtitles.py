"""Drones' subtitles: first and last cue of public samples, and every dialect written and read back."""

import math
import random
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import av
import numpy as np
import orjson
import pytest

from aerodft.adapters.telemetry import CompositeDecoder, SubtitleLog, open_log
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.errors import InputError
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import CameraTrack, GimbalTrack, HeightTrack, PositionTrack, RawBlock, Track, VehicleTrack
from replay.recordings import Recording
from tests.adapters.telemetry import srt_writer as w
from tests.commands import run_aerodft
from tests.nights import at_night

ZERO = (0.0, 0.0, 0.0)
# name: cues, (lat, lon, height above take-off, gimbal yaw/pitch/roll) of the first and the last cue; None: not stated
TRUTH: dict[str, tuple[int, tuple[Any, ...], tuple[Any, ...]]] = {
    "DJI_0023_srtcnt_dzoom_head.SRT": (183, (41.151572, 16.412772, 50.7, None), (41.151885, 16.412959, 45.2, None)),
    "M30T_0001_head.SRT": (
        218,
        (47.774878, 14.184823, 69.984, (0.1, -90.0, 0.0)),
        (47.774945, 14.184485, 69.341, (0.0, -90.0, 0.0)),
    ),
    "M30T_0001_tail.SRT": (
        214,
        (47.774726, 14.182977, 53.014, (0.0, -89.1, 0.0)),
        (47.774883, 14.183124, 58.197, (0.0, -89.1, 0.0)),
    ),
    "air2s.srt": (17, (41.424724, 2.234156, None, None), (41.424730, 2.234102, None, None)),
    "air3s.SRT": (5, (34.270373, -84.176160, 0.0, None), (34.270373, -84.176160, 0.0, None)),
    "avata360.SRT": (
        5,
        (53.365080, 6.460739, 5.4, (-162.8, 0.0, 0.0)),
        (53.365080, 6.460739, 5.4, (-162.8, 0.0, 0.0)),
    ),
    "broken_incomplete.SRT": (20, (-34.7383, -58.4563, 20.1, None), (None, None, None, None)),
    "broken_incomplete2.SRT": (6, (-34.869950, -57.823395, None, None), (None, None, None, None)),
    "matrice_300.srt": (381, (36.6146, -6.1120, 0.3, None), (36.6146, -6.1120, 0.0, None)),
    "mavic_2_style_notimecode.SRT": (76, (-20.2533, 149.0251, None, None), (-20.2534, 149.0253, None, None)),
    "mavic_2pro_new_head.SRT": (218, (-35.080155, -60.286702, None, None), (-35.081059, -60.286284, None, None)),
    "mavic_mini.SRT": (117, (48.0771, -121.7458, 200.7, None), (48.0775, -121.7476, 200.8, None)),
    "mavic_pro.SRT": (468, (-20.2533, 149.0251, 1.9, None), (-20.2532, 149.0251, 0.0, None)),
    "mavic_pro_buggy.SRT": (546, (42.4668, -1.2218, 0.0, None), (42.4668, -1.2217, 15.8, None)),
    "mix_p4rtk_mavic2pro.srt": (
        12,
        (-34.650200, -59.409424, 17.39, (-76.0, -27.3, 0.0)),
        (-34.651180, -59.409483, None, None),
    ),
    "neo2_nogps.SRT": (6, (None, None, 0.4, None), (32.848932, -84.861966, 0.4, None)),
    "old_format_Hb_Hs.SRT": (68, (-20.2533, 149.0251, 1.9, None), (-20.2534, 149.0253, 17.9, None)),
    "p4_rtk.SRT": (
        55,
        (-34.237922, -58.851745, 85.8, (110.4, -24.4, 0.0)),
        (-34.232349, -58.849196, 85.8, (111.9, -24.4, 0.0)),
    ),
    "p4p_sample.SRT": (5, (47.4692, 8.2090, 45.6, None), (47.4692, 8.2090, 45.6, None)),
}


def read(path: Path) -> tuple[dict[int, dict[str, Any]], list[int], CompositeDecoder, SubtitleLog]:
    """Values by arrival, all arrivals, the decoder and the log."""
    log, decoder = SubtitleLog([path]), CompositeDecoder()
    arrivals: list[int] = []
    values: dict[int, dict[str, Any]] = {}
    for block in log.events():
        assert isinstance(block, RawBlock)
        arrivals += block.arrival_ns.tolist()
        for track in decoder.decode(block):
            for row, at_ns in enumerate(track.arrival_ns.tolist()):
                values.setdefault(at_ns, {}).update(_row(track, row))
    return values, arrivals, decoder, log


def _row(track: Track, row: int) -> dict[str, Any]:
    match track:
        case PositionTrack():
            return {"lat": math.degrees(track.lat_rad[row]), "lon": math.degrees(track.lon_rad[row])}
        case HeightTrack():
            return {"height": float(track.value_m[row])}
        case GimbalTrack():
            yaw, pitch, roll = np.degrees(yaw_pitch_roll(track.wxyz[row]))
            return {"gimbal": (float(yaw), float(pitch), float(roll))}
        case VehicleTrack():
            assert track.heading_std_rad is not None
            yaw = math.degrees(yaw_pitch_roll(track.wxyz[row])[0])
            return {"body": None if track.heading_std_rad[row] > 3 else yaw}
        case CameraTrack():
            return {"hfov": math.degrees(track.hfov_rad[row])}
    return {}


@pytest.mark.parametrize("name", TRUTH)
def test_first_and_last_cue_of_the_samples(data_folder: Path, name: str) -> None:
    path = data_folder / "flights/srt" / name
    if not path.exists():
        pytest.skip("no flights in the data folder")
    count, *ends = TRUTH[name]
    values, arrivals, _, log = read(path)
    assert len(arrivals) == count
    assert log.counts.frames == count
    for at_ns, (lat, lon, height, gimbal) in zip((arrivals[0], arrivals[-1]), ends, strict=True):
        found = values[at_ns]
        assert [found.get(key) for key in ("lat", "lon", "height")] == pytest.approx([lat, lon, height], abs=1e-9)
        if gimbal is None or gimbal[1] <= -89.95:  # at nadir yaw and roll are one
            assert ("gimbal" in found) == (gimbal is not None)
        else:
            assert found["gimbal"] == pytest.approx(gimbal, abs=1e-6)


def test_a_cut_video_goes_on(data_folder: Path, tmp_path: Path) -> None:
    path = data_folder / "flights/srt/M30T_0001_head.SRT"
    if not path.exists():
        pytest.skip("no flights in the data folder")
    _, arrivals, _, _ = read(path)
    assert arrivals[0] == pytest.approx(1724312512070000000, abs=20_000_000)  # the median of clocks that jitter
    assert arrivals[-1] - arrivals[0] == 7_240_999_999
    first, second = tmp_path / "DJI_0001.SRT", tmp_path / "dji_0002.srt"
    cues = w.moments(30)
    first.write_bytes(w.srt_file("m3t", cues))
    second.write_bytes(w.srt_file("m3t", w.moments(30, start=cues[-1].clock + (cues[1].clock - cues[0].clock) * 2)))
    log = SubtitleLog([second, first])
    blocks = [block for block in log.events() if isinstance(block, RawBlock)]
    stamps = np.concatenate([block.arrival_ns for block in blocks])
    last_ns = 999_999  # the last cue of a file is taken at the end of its millisecond
    steps = [33_000_000] * 28 + [33_000_000 + last_ns, 66_000_000 - last_ns] + [33_000_000] * 28
    assert np.diff(stamps).tolist() == [*steps, 33_000_000 + last_ns]
    with pytest.raises(InputError, match="of one time"):
        SubtitleLog([first, first])


@pytest.mark.parametrize("dialect", w.DIALECTS)
def test_every_dialect_is_read_back(tmp_path: Path, dialect: str) -> None:
    path = tmp_path / "clip.SRT"
    path.write_bytes(w.srt_file(dialect))
    values, arrivals, decoder, log = read(path)
    assert len(arrivals) == 60
    assert decoder.rejected == Counter()
    decimals = 4 if dialect in {"xt2", "mavic_pro"} else 6
    for moment, at_ns in zip(w.moments(), arrivals, strict=True):
        found = values[at_ns]
        assert found["lat"] == pytest.approx(round(moment.lat, decimals), abs=1e-9)
        assert found["lon"] == pytest.approx(round(moment.lon, decimals), abs=1e-9)
        assert ("height" in found) == (dialect not in w.WITHOUT_HEIGHT)
        if "height" in found:
            assert found["height"] == pytest.approx(moment.height, abs=0.051)
        if dialect in w.WITH_ANGLES:
            assert found["gimbal"] == pytest.approx((moment.yaw, moment.pitch, 0.0), abs=1e-6)
        else:  # the body's angles are not the camera's
            assert "gimbal" not in found
            assert found["body"] == (pytest.approx(moment.yaw) if dialect == "m2e" else None)
    said = " ".join(log.warnings())
    assert ("no angles of the camera" in said) == (dialect not in w.WITH_ANGLES)
    assert ("no height above the take-off point" in said) == (dialect in w.WITHOUT_HEIGHT)


def test_focal_lengths_and_zooms_of_both_encodings(tmp_path: Path) -> None:
    path = tmp_path / "clip.SRT"
    hfovs = {}
    for dialect in ("h20n", "h20t", "m2zoom", "mavic3"):
        path.write_bytes(w.srt_file(dialect))
        values, *_, log = read(path)
        hfovs[dialect] = {round(each["hfov"], 4) for each in values.values()}
        assert "the camera zooms" not in " ".join(log.warnings())
    assert hfovs["m2zoom"] == hfovs["mavic3"] == {round(2 * math.degrees(math.atan(34.61 / 48)), 4)}
    assert hfovs["h20n"] == {round(2 * math.degrees(math.atan(34.61 / 2 / (52 * 1.7871))), 4)}
    assert hfovs["h20t"] == {round(2 * math.degrees(math.atan(34.61 / 2 / (58 * 1.79))), 4)}
    path.write_bytes(w.srt_file("m2zoom").replace(b"[focal_len : 240]", b"[focal_len : 480]", 20))
    assert "the camera zooms" in " ".join(SubtitleLog([path]).warnings())


@pytest.mark.parametrize(
    ("gps", "place", "said"),
    [
        ("GPS(149.0251,-20.2533,16)", (-20.2533, 149.0251), ""),  # beyond 90: a longitude
        ("GPS(-20.2533,149.0251,16)", (-20.2533, 149.0251), ""),
        ("GPS(8.2090,47.4692,18)", (47.4692, 8.2090), ""),  # satellites: longitude first
        ("GPS(47.4692,8.2090,0.0M)", (47.4692, 8.2090), ""),  # metres: latitude first
        ("GPS(47.4692,8.2090)", None, "which number is the latitude"),
        ("GPS(47.4692,8.2090,431.7)", None, "which number is the latitude"),
        ("GPS(47.4692,8.20", None, "half of a place"),
        ("GPS(N/A,N/A,3)", None, "no position yet"),
        ("GPS(0.0,0.0,0)", None, "no position yet"),
        ("GPS(200.0,100.0,12)", None, "no place on Earth"),
        # a way home of 501 m to the east, with the order of coordinates that the satellites do not suggest
        ("GPS(60.0000,10.0090,12) HOME(60.0000,10.0000) D 501.00m,", None, "contradicts the order"),
        ("GPS(10.0000,60.0090,12) HOME(10.0000,60.0000) D 1000.00m,", (60.0090, 10.0000), ""),
    ],
)
def test_the_order_of_coordinates_is_by_evidence(
    tmp_path: Path, gps: str, place: tuple[float, float] | None, said: str
) -> None:
    path = tmp_path / "clip.srt"
    path.write_text(f"1\n00:00:00,000 --> 00:00:01,000\n2020.01.01 10:00:00\n{gps} BAROMETER:10.0\n\n")
    values, arrivals, decoder, _ = read(path)
    found = values[arrivals[0]]
    assert found["height"] == 10.0
    if place is None:
        assert "lat" not in found
        assert said in " ".join(decoder.rejected)
    else:
        assert (found["lat"], found["lon"]) == pytest.approx(place, abs=1e-9)


@pytest.mark.parametrize(
    ("order", "gps", "place", "said"),
    [
        ("lat,lon", "GPS(47.4692,8.2090)", (47.4692, 8.2090), ""),
        ("lon,lat", "GPS(8.2090,47.4692,431.7)", (47.4692, 8.2090), ""),
        ("lat,lon", "GPS(47.4692,8.2090,18)", (47.4692, 8.2090), ""),  # against what most drones do
        ("lat,lon", "GPS(149.0251,-20.2533,16)", None, "the latitude is beyond 90 deg"),
        ("lon,lat", "GPS(60.0000,10.0090,12) HOME(60.0000,10.0000) D 501.00m,", None, "contradicts the order"),
    ],
)
def test_a_stated_order_of_coordinates_counts(
    order: str, gps: str, place: tuple[float, float] | None, said: str
) -> None:
    cue = f"1\n00:00:00,000 --> 00:00:01,000\n{gps} BAROMETER:10.0\n\n".encode()
    decoder = CompositeDecoder(FollowedIds(gps_lon_first=order == "lon,lat"))
    zero, size = np.zeros(1, dtype=np.int64), np.array([len(cue)])
    tracks = decoder.decode(RawBlock(protocol="srt", sender="", arrival_ns=zero, offset=zero, length=size, data=cue))
    places = [each for each in tracks if isinstance(each, PositionTrack)]
    if place is None:
        assert not places
        assert said in " ".join(decoder.rejected)
    else:
        assert np.degrees([places[0].lat_rad[0], places[0].lon_rad[0]]) == pytest.approx(place, abs=1e-9)


def test_places_near_home_are_refused_where_farther_ones_contradict_their_order(tmp_path: Path) -> None:
    path = tmp_path / "clip.srt"
    cue = "{n}\n00:00:0{n},000 --> 00:00:01,000\nGPS(60.0000,{lon},12) HOME(60.0000,10.0000) D {d:.2f}m, H 9.00m\n\n"
    places = ((1, "10.0001", 5.6), (2, "10.0090", 501.0), (3, "10.0002", 11.1))
    path.write_text("".join(cue.format(n=n, lon=lon, d=d) for n, lon, d in places))
    values, _, decoder, _ = read(path)
    assert not any("lat" in each for each in values.values())
    assert decoder.rejected["SRT: GPS: the distance to HOME contradicts the order of latitude and longitude"] == 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[rel_alt: 40.0 abs_alt: 90.0] [rel_alt: 41.0 abs_alt: 91.0]", "rel_alt stands there twice"),
        ("[rel_alt: 40,5 abs_alt: 90.0]", "rel_alt is cut or no number"),
        ("[rel_alt: nan abs_alt: 90.0]", "rel_alt is cut or no number"),
        ("[rel_alt: 1e9 abs_alt: 90.0]", "rel_alt is cut or no number"),
        ("[rel_alt: 99999999.0 abs_alt: 90.0]", "rel_alt is no height"),
        ("[rel_alt: 4", "rel_alt is cut or no number"),
        ("[rel_alt: 40.0 abs_alt: 9.0] BAROMETER:12.0\n", "heights by rel_alt and BAROMETER"),
        ("BAROMETER:1", "BAROMETER is cut or no number"),
        ("[gb_yaw: 1.0 gb_pitch: -30.0]", "a part of the camera's angles"),
        ("[gb_yaw: 1.0 gb_pitch: -999.0 gb_roll: 0.0]", "impossible angles"),
        ("G.PRY (-24.4, 0.0", "G.PRY is cut"),
    ],
)
def test_what_cannot_be_read_is_refused_and_said(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "clip.srt"
    path.write_text(f"1\n00:00:00,000 --> 00:00:01,000\nFrameCnt: 1, DiffTime: 33ms\n2020-01-01 10:00:00.000\n{text}")
    values, arrivals, decoder, _ = read(path)
    assert not {"height", "gimbal"} & values[arrivals[0]].keys()
    assert said in " ".join(decoder.rejected)


@pytest.mark.parametrize("first", [0, *at_night(*range(200, 2000, 200))])
def test_damaged_subtitles_give_what_was_written_or_nothing(tmp_path: Path, first: int) -> None:
    """Cues cut, lost, doubled and mixed, garbage between: no value that no cue has, and losses are said."""
    wholes = {name: w.srt_file(name).decode() for name in w.DIALECTS}
    path = tmp_path / "clip.srt"
    for seed in range(first, first + 200):
        draw = random.Random(seed)  # noqa: S311
        dialect = draw.choice(list(wholes))
        text = _damaged(draw, wholes[dialect], wholes)
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
        try:
            values, arrivals, decoder, log = read(path)
        except InputError:
            continue
        assert np.all(np.diff(arrivals) > 0)
        heights = {round(m.height, 2) for m in w.moments()} | {round(m.height, 1) for m in w.moments()}
        lats = {round(m.lat, n) for m in w.moments() for n in (4, 6)}
        for found in values.values():
            assert "height" not in found or round(found["height"], 3) in heights, seed
            assert "lat" not in found or round(found["lat"], 7) in lats, seed
            assert "lon" not in found or round(found["lon"], 4) == 171.1936, seed
            assert "gimbal" not in found or found["gimbal"] == pytest.approx((-35.4, -60.3, 0.0), abs=1e-6), seed
        whole = sum(all(each in found for each in ("lat", "lon")) for found in values.values())
        said = decoder.rejected or log.warnings()
        assert whole == 60 or said or len(arrivals) != 60, seed


def _damaged(draw: random.Random, text: str, others: dict[str, str]) -> str:
    for _ in range(draw.randrange(1, 4)):
        at = draw.randrange(len(text))
        match draw.randrange(8):
            case 0:
                text = text[:at]
            case 1:  # a span within the text is lost, up to a line's end
                text = text[:at] + text[text.find("\n", at) :]
            case 2:
                text = "\ufeff" + text
            case 3:
                text = text.replace("\n", "\r\n")
            case 4:  # blank lines anywhere
                line = text.find("\n", at)
                text = text[:line] + "\n\n" + text[line:]
            case 5:  # one number becomes none
                key = draw.choice(["latitude", "rel_alt", "gb_pitch", "BAROMETER", "altitude"])
                text = re.sub(
                    rf"({key} ?: ?)[-\d.]+", rf"\g<1>{draw.choice(['nan', '', '--', '1e999'])}", text, count=1
                )
            case 6:
                other = others[draw.choice(list(others))]
                text = text + "\n\n" + other[: draw.randrange(len(other))]
            case 7:
                line = text.find("\n", at)
                text = text[:line] + "\n\udc80\udcff garbage [] ::" + text[line:]
    return text


@pytest.mark.parametrize("content", [b"", b"1\n00:00:00,000 --> 00:00:01,000\nHello there\n\n", b"words\n" * 90])
def test_subtitles_of_a_film_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "film.srt"
    path.write_bytes(content)
    with pytest.raises(InputError):
        open_log(path)


STATION = """
[station]
name = "subtitled"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
home_above_plane_m = 1.5
[record]
image_hz = 0
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
[[probe]]
name = "across"
kind = "distance"
pixels = [[11.5, 23.5], [51.5, 23.5]]
[[probe]]
name = "place"
kind = "position"
pixels = [[31.5, 23.5]]
"""


ASS_HEADER = b"""[Script Info]
ScriptType: v4.00+

[V4+ Styles]
Format: Name, Fontname, Fontsize, PrimaryColour
Style: Default,Arial,16,&Hffffff

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""


def _video(path: Path, images: int, subtitles: str | None = None, created: str = "2024-02-28T00:13:26Z") -> Path:
    """A video of 30 images per second, with subtitles inside where they are given."""
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata["creation_time"] = created
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height = 64, 48
        for k in range(images):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), k % 200, dtype=np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    if subtitles is not None:
        _with_text(path, subtitles).replace(path)
    return path


def _with_text(path: Path, subtitles: str) -> Path:
    both = path.with_name("both.mp4")
    srt = path.with_name("inside.tmp.srt")
    srt.write_text(subtitles)
    with av.open(str(path)) as video, av.open(str(srt)) as text, av.open(str(both), "w") as out:
        out.metadata["creation_time"] = "2024-02-28T00:13:26Z"
        to_video = out.add_stream_from_template(video.streams.video[0])
        to_text = out.add_stream("mov_text")
        to_text.codec_context.subtitle_header = ASS_HEADER
        for packet in video.demux(video.streams.video[0]):
            if packet.dts is not None:
                packet.stream = to_video
                out.mux(packet)
        for packet in text.demux(text.streams.subtitles[0]):
            if packet.pts is not None:
                data = bytes(packet)
                new = av.Packet(len(data).to_bytes(2, "big") + data)
                new.pts, new.dts, new.duration = packet.pts, packet.pts, packet.duration
                new.time_base, new.stream = packet.time_base, to_text
                out.mux(new)
    srt.unlink()
    return both


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION)
    return tmp_path


def _imported(desk: Path, *files: Path, options: Iterable[str] = ()) -> dict[str, list[dict[str, Any]]]:
    out = desk / f"out{len(list(desk.iterdir()))}"
    done = run_aerodft("import", *files, "-c", desk / "station.toml", "-o", out, "--json", *options)
    assert done.code == 0, done.err
    found: dict[str, list[dict[str, Any]]] = {}
    for each in map(orjson.loads, Recording(out).measurements()):
        found.setdefault(each["name"], []).append(each)
    again = run_aerodft("recompute", out, "-o", desk / "again", "--json")
    assert again.code == 0, again.err
    values = [orjson.loads(each)["value"] for each in Recording(desk / "again").measurements()]
    assert values == [orjson.loads(each)["value"] for each in Recording(out).measurements()]
    return found


@pytest.mark.parametrize("inside", [False, True])
def test_a_clip_alone_is_a_flight(desk: Path, *, inside: bool) -> None:
    text = w.srt_file("m3t", w.moments(58)).decode()
    clip = _video(desk / "DJI_0001.MP4", 58, text if inside else None)
    if not inside:
        (desk / "dji_0001.srt").write_text(text)
    found = _imported(desk, clip)
    ranges = [each for each in found["centre"] if each["status"] == "ok"]
    assert len(found["centre"]) == 58
    assert len(ranges) >= 55
    start_ns = int(found["centre"][0]["stamp_ns"])
    assert start_ns == pytest.approx(1709079206240000000, abs=1_000_000)
    for each in ranges:
        seconds = (int(each["stamp_ns"]) - start_ns) / 1e9
        assert each["value"] == pytest.approx((40.05 + seconds + 1.5) / math.sin(math.radians(60.3)), abs=0.03)


def test_parts_of_a_cut_video_are_one_flight(desk: Path) -> None:
    cues = w.moments(30)
    later = w.moments(30, start=cues[-1].clock + (cues[1].clock - cues[0].clock) * 2)
    for name, part in (("DJI_0001", cues), ("DJI_0002", later)):
        _video(desk / f"{name}.MP4", 30)
        (desk / f"{name}.SRT").write_bytes(w.srt_file("m3t", part))
    found = _imported(desk, desk / "DJI_0001.MP4", desk / "DJI_0002.MP4")
    images = [each["image"] for each in found["centre"]]
    assert images == list(range(60))
    stamps = np.diff([int(each["stamp_ns"]) for each in found["centre"]]) / 1e6
    assert max(stamps) == pytest.approx(29 * 33 + 66 - 29 * 1000 / 30, abs=1.0)


def test_without_angles_the_tilt_is_asked_for(desk: Path) -> None:
    clip = _video(desk / "DJI_0001.MP4", 30)
    (desk / "DJI_0001.SRT").write_bytes(w.srt_file("mavic3", w.moments(30)))
    refused = run_aerodft("import", clip, "-c", desk / "station.toml", "-o", desk / "no")
    assert refused.code == 4
    assert "--tilt" in refused.err
    found = _imported(desk, clip, options=["--tilt", "30"])
    ok = [each for each in found["centre"] if each["status"] == "ok"]
    assert len(ok) >= 28
    assert ok[0]["value"] == pytest.approx(41.55 / math.cos(math.radians(30)), abs=0.1)
    assert ok[0]["pose"]["std"]["heading_deg"] == pytest.approx(180.0)  # nobody knows where north is
    across = [each for each in found["across"] if each["status"] == "ok"]
    assert across[0]["value"] == pytest.approx(
        ok[0]["value"] * 40 / 31.5 * math.tan(math.radians(30)) * 31.5 / 32, rel=0.02
    )
    assert across[0]["std"] < 0.1 * across[0]["value"]
    assert all(each["status"] != "ok" or max(each["ellipse95"].values(), key=float) > 20 for each in found["place"])


@pytest.mark.parametrize(("created", "hours"), [("2024-02-27T23:13:26Z", 1), ("2024-02-28T00:13:26Z", 0)])
def test_the_zone_is_by_the_videos_creation_time(desk: Path, created: str, hours: int) -> None:
    _video(desk / "clip.mp4", 3, created=created)
    (desk / "clip.srt").write_bytes(w.srt_file("m3t", w.moments(3)))
    log = SubtitleLog([desk / "clip.mp4"])
    assert log.start_ns == pytest.approx(1709079206240000000 - hours * 3600 * 10**9, abs=1)
    assert f"UTC{hours:+g} h by the video's creation time" in " ".join(log.warnings())
    alone = SubtitleLog([desk / "clip.srt"])
    assert alone.start_ns == log.start_ns


def test_a_video_without_subtitles_says_what_to_do(desk: Path) -> None:
    clip = _video(desk / "clip.mp4", 3)
    with pytest.raises(InputError, match=r"put the \.SRT beside it"):
        open_log(clip)


@pytest.mark.parametrize("dialect", ["m3t", "mavic3", "m2zoom"])
def test_init_writes_a_station_for_a_clip(desk: Path, dialect: str) -> None:
    clip = _video(desk / "DJI_0001.MP4", 30)
    (desk / "DJI_0001.SRT").write_bytes(w.srt_file(dialect, w.moments(30)))
    done = run_aerodft("init", clip, "-o", desk / "mine", "--json")
    assert done.code == 0, done.err
    said = " ".join([*done.json["taken"], *done.json["to_do"]])
    assert "equivalent to 35 mm film, by the subtitles" in said
    assert ("tilt" in said) == (dialect != "m3t")
    assert ("manual_m" in said) == (dialect == "m2zoom")
    assert "photographs" not in said
    imported = run_aerodft("import", clip, "-c", desk / "mine/station.toml", "-o", desk / "out", "--json")
    assert imported.code == 0, imported.err
    values = [orjson.loads(each) for each in Recording(desk / "out").measurements()]
    statuses = Counter(each["status"] for each in values)
    assert statuses["ILL_CONDITIONED" if dialect == "m2zoom" else "ok"] >= 28  # a height of 40 m is known to 20 m
