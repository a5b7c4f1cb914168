"""Tables of a gauge's readings: people's own and agencies', written by the tests and read back; and damaged ones."""

import itertools
import random
import re

import pytest
from numpy.testing import assert_allclose

from aerodft.adapters.config.station import load_station, parse_station, resolved_toml
from aerodft.adapters.config.station.level_file import LevelTerms, read_levels
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.errors import ConfigError

T0_S = 1_777_629_600  # 2026-05-01T10:00:00Z
LEVELS_M = (1.0, 1.25, -0.375, 12.5, 0.125)
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
STATION = """
[station]
name = "s"
[camera]
name = "c"
width_px = 64
height_px = 48
hfov_deg = 60.0
[pose]
height_agl_m = 8.0
tilt_deg = 60.0
"""


@pytest.fixture
def read(tmp_path):
    def reading(text, encoding="utf-8", **terms):
        path = tmp_path / "gauge.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return read_levels(path, LevelTerms(**terms))

    return reading


def stamp_s(k):
    return T0_S + 900 * k


def iso(k, hours=0):
    text = unix_ns_to_iso((stamp_s(k) + 3600 * hours) * 10**9)
    return text if not hours else text.replace("Z", f"{hours:+03d}:00")


TIMES = {
    "iso": ("time", iso),
    "offset": ("timestamp", lambda k: iso(k, 2)),
    "space": ("Date Time (UTC)", lambda k: iso(k).replace("T", " ").removesuffix("Z")),
    "minutes": ("datetime", lambda k: iso(k).replace(":00Z", "Z")),
    "german": ("Zeit UTC", lambda k: re.sub(r"(....)-(..)-(..)T(.*)Z", r"\3.\2.\1 \4", iso(k))),
    "unix": ("unix_s", lambda k: str(stamp_s(k))),
    "ms": ("unix_ms", lambda k: str(1000 * stamp_s(k))),
    "ns": ("stamp_ns", lambda k: str(10**9 * stamp_s(k))),
    "epoch": ("Unix Time", lambda k: f"{stamp_s(k)}.0"),
    "bare": ("time", lambda k: str(stamp_s(k))),
}


@pytest.mark.parametrize(
    ("time", "delimiter", "unit", "comma"),
    [
        each
        for each in itertools.product(TIMES, (",", ";", "\t"), METRES, (False, True))
        if not (each[1] == "," and each[3])
    ],
)
def test_what_a_writer_wrote_is_read_back(read, time, delimiter, unit, comma):
    name, text_of = TIMES[time]
    lines = ["# Gauge of the tests", delimiter.join((name, f"Level [{unit}]", "std"))]
    for k in range(len(LEVELS_M)):
        numbers = [f"{LEVELS_M[k] / METRES[unit]:.5f}", f"{0.01 * (k + 1) / METRES[unit]:.5f}"]
        lines.append(delimiter.join((text_of(k), *(each.replace(".", ",") if comma else each for each in numbers))))
        lines += ["", "# between"] if k == 1 else []
    found = read("\ufeff" + "\r\n".join(lines))
    assert [each.stamp_ns for each in found] == [stamp_s(k) * 10**9 for k in range(len(LEVELS_M))]
    assert_allclose([each.level_m for each in found], LEVELS_M, atol=2e-6)
    assert_allclose([each.std_m for each in found], [0.01, 0.02, 0.03, 0.04, 0.05], atol=2e-6)


USGS = """# ---------------------------------- WARNING ----------------------------------
# Data provided for site 01646500
agency_cd\tsite_no\tdatetime\ttz_cd\t69928_00065\t69928_00065_cd
5s\t15s\t20d\t6s\t14n\t10s
USGS\t01646500\t2026-05-01 06:00\tEDT\t3.00\tP
USGS\t01646500\t2026-05-01 06:15\tEDT\tIce\tP
USGS\t01646500\t2026-05-01 06:30\tEDT\t3.10\tP
USGS\t01646500\t2026-05-01 06:45\tEDT\t3.20\tP
"""
NOAA = """Date Time, Water Level, Sigma, O or I (for verified), F, R, L, Quality
2026-05-01 10:00,3.00,0.010,0,0,0,0,v
2026-05-01 10:30,3.10,0.020,0,0,0,0,v
2026-05-01 10:45,3.20,0.030,0,0,0,0,v
"""
EA = """dateTime,measure,value
2026-05-01T10:45:00Z,http://environment.example/id/measures/E1,3.2
2026-05-01T10:30:00Z,http://environment.example/id/measures/E1,3.1
2026-05-01T10:00:00Z,http://environment.example/id/measures/E1,3.0
"""
WSV = """Zeitpunkt;Wasserstand [cm]
2026-05-01T12:00:00+02:00;300,0
2026-05-01T12:15:00+02:00;-777
2026-05-01T12:30:00+02:00;310,0
2026-05-01T12:45:00+02:00;320,5
"""


@pytest.mark.parametrize(
    ("text", "terms", "levels_m"),
    [
        (USGS, {}, (3.0 * 0.3048, 3.1 * 0.3048, 3.2 * 0.3048)),
        (NOAA, {"unit": "m", "utc_offset": "Z"}, (3.0, 3.1, 3.2)),
        (EA, {"unit": "m"}, (3.0, 3.1, 3.2)),
        (WSV, {}, (3.0, 3.1, 3.205)),
    ],
    ids=["usgs", "noaa", "ea", "wsv"],
)
def test_exports_of_agencies_are_read(read, text, terms, levels_m):
    found = read(text, **terms)
    assert [each.stamp_ns // 10**9 for each in found] == [stamp_s(k) for k in (0, 2, 3)]
    assert_allclose([each.level_m for each in found], levels_m, atol=1e-12)


def test_columns_are_named_where_they_are_not_the_usual_ones(read):
    text = "when;upstream (m);downstream (m);+-\n" + "".join(f"{iso(k)};{k};{k + 10};0.1\n" for k in range(3))
    found = read(text, columns={"time": "when", "level": "Downstream (m)", "std": "+-"})
    assert [(each.level_m, each.std_m) for each in found] == [(10.0, 0.1), (11.0, 0.1), (12.0, 0.1)]


def test_date_and_time_may_be_two_columns(read):
    text = "date,time,level_m\n" + "".join(f"2026-05-01,10:{k}0:00,{k}\n" for k in range(3))
    assert [each.stamp_ns // 10**9 for each in read(text, utc_offset="Z")] == [T0_S, T0_S + 600, T0_S + 1200]


def test_utf_16_and_latin_1_are_text_too(read):
    text = "Zeit UTC;Wasserstand über Null_m\n"
    text = text.replace("_m", " [m]") + "".join(f"{iso(k)};{k},5\n" for k in range(3))
    columns = {"level": "Wasserstand über Null [m]"}
    for encoding in ("utf-16", "latin-1", "utf-8-sig"):
        assert [each.level_m for each in read(text, encoding, columns=columns)] == [0.5, 1.5, 2.5]


def rows(*lines, head="time,level_m"):
    good = [f"{iso(k)},{k}.5" for k in range(4)]
    return "\n".join([head, *good, *lines]) + "\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "wrong type of file: got an empty file"),
        (b"\x00\x01\x02", "wrong type of file: got unknown binary data"),
        ("# only\n", "no readings: got no line but comments"),
        (rows("yesterday,1"), "line 6: no time: got 'yesterday', expected a time like 2026-05-01T10:15:00Z"),
        (rows("2026-05-01 10:15,1"), "line 6: a time of an unknown zone.*ground.level_utc_offset"),
        (rows("05/01/2026 10:15,1"), "line 6: no time"),
        (rows("20260501,1"), "line 6: no time"),
        (rows("2026050110,1"), "line 6: no time"),
        (rows("1777629600000,1"), "line 6: no time"),
        (rows("2026-13-01T10:15:00Z,1"), "line 6: no time"),
        (rows("2026-05-01T11:15:00Z,high"), "line 6: no level: got 'high', expected a number in 'level_m'"),
        (rows("2026-05-01T11:15:00Z,1e400"), "line 6: no level"),
        (rows("2026-05-01T11:15:00Z,1_0"), "line 6: no level"),
        (rows("2026-05-01T11:15:00Z,123456"), "line 6: an impossible level: got 123456 m"),
        (rows("2026-05-01T11:15:00Z,1,25"), "line 6: a line of another length: got 3 cells, expected 2 cells"),
        (rows("2026-05-01T11:15:00Z"), "line 6: a line of another length: got 1 cell"),
        (rows("2026-05-01T10:00:00Z,9"), "line 6: two levels at one time: got 9 m, and 0.5 m in line 2"),
        (rows(head="time,level"), "line 1: levels without a unit.*level_unit"),
        (rows(head="time,flow_m3s"), "line 1: no column of the level: got 'time', 'flow_m3s'"),
        (rows(head="when,level_m"), "line 1: no column of the time"),
        (rows(head="2026-05-01T10:00:00Z,1.5"), "line 1: no column of the time"),
        ("time,level_m,stage_ft\n", "line 1: several columns may be the level: got 'level_m' and 'stage_ft'"),
        ("time,level_m\n" + f"{iso(0)},1\n{iso(1)},2\n", "too few readings: got 2 readings, expected at least 3"),
        ("time;level_m\n" + "".join(f"{iso(k)};1,{k}00\n" for k in range(3)), "an ambiguous comma: got '1,000'"),
        (f"time;level_m\n{iso(0)};1,5\n{iso(1)};1.5\n", "line 3: numbers with points and with commas"),
        ("time,level_m,std_m\n" + f"{iso(0)},1,-1\n", "line 2: an impossible standard deviation: got -1 m"),
        ("time,level_m,std_m\n" + f"{iso(0)},1,x\n", "line 2: no standard deviation: got 'x'"),
        ("datetime,tz_cd,level_m\n2026-05-01 10:00,XYZ,1\n", "line 2: a time of an unknown zone: got 'XYZ'"),
    ],
)
def test_a_bad_line_is_one_sentence_with_its_place(read, text, said):
    with pytest.raises(ConfigError, match=said) as error:
        read(text)
    assert "gauge.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_units_that_contradict_each_other_are_refused(read):
    with pytest.raises(ConfigError, match=r'two units: got ground\.level_unit = "m", expected ft'):
        read(rows(head="time,stage_ft"), unit="m")


def test_an_hour_said_twice_in_autumn_is_refused(read):
    text = "time,level_m\n" + "".join(f"2026-10-25 {h}:30:00,{k}\n" for k, h in enumerate(("01", "02", "02", "03")))
    with pytest.raises(ConfigError, match=r"two levels at one time.*autumn"):
        read(text, utc_offset="+01:00")


def damaged(text, rng):
    """A text with one to three mistakes of the kinds that editors, exports and transfers make."""
    data = bytearray(text.encode())
    for _ in range(rng.randint(1, 3)):
        at, kind = rng.randrange(len(data) + 1), rng.randrange(7)
        match kind:
            case 0:
                del data[at:]
            case 1:
                del data[at : at + rng.randint(1, 9)]
            case 2:
                data[at:at] = bytes([rng.randrange(256)])
            case 3:
                data[at:at] = rng.choice(
                    [b"\n", b'"', b"\r", b",", b";", b"nan", b"-", b"e9", b"\0", "\u2212".encode()]
                )
            case 4:
                lines = bytes(data).split(b"\n")
                rng.shuffle(lines)
                data = bytearray(b"\n".join(lines))
            case 5:
                data = bytearray(bytes(data).replace(b".", b",", rng.randint(1, 4)))
            case _:
                data[at:at] = bytes(data[: rng.randint(0, 60)])
        data = data or bytearray(b"x")
    return bytes(data)


def numbers_of(line):
    """All numbers that a line may be read as."""
    texts = [
        *re.split(rb'[;\t|,"\s]+', line),
        *(each.replace(b",", b".") for each in re.findall(rb"[-+]?\d*,\d+", line)),
    ]
    return {float(each) for each in texts if re.fullmatch(rb"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", each, re.IGNORECASE)}


@pytest.mark.parametrize(
    ("text", "unit"),
    [(USGS, "ft"), (NOAA, "m"), (EA, "m"), (WSV, "cm"), (rows(), "m")],
    ids=["usgs", "noaa", "ea", "wsv", "own"],
)
def test_damaged_tables_are_refused_in_a_sentence_or_give_what_a_line_of_them_says(read, text, unit):
    rng, refused = random.Random(7), 0  # noqa: S311 - of a test
    head = next(line for line in text.splitlines() if not line.startswith("#")).encode()
    for _ in range(400):
        data = damaged(text, rng)
        try:
            found = read(data, unit="m" if text in (NOAA, EA) else None, utc_offset="Z")
        except ConfigError as error:
            refused += 1
            said = str(error)
        else:
            said = "gauge.csv"
            units = [METRES[unit]] if head in data else METRES.values()  # a header that lost its c is of metres
            held = {
                round(each * unit_m, 9) for line in data.split(b"\n") for each in numbers_of(line) for unit_m in units
            }
            assert all(round(each.level_m, 9) in held and each.std_m >= 0 for each in found)
        assert "gauge.csv" in said
    assert refused > 40


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('level = "none.csv"', "none.csv: no such file"),
        ("level = 3.5", "ground.level: got 3.5, expected"),
        ("level_std_m = 0.1", "ground.level_std_m: got no level beside it"),
        ('level = "gauge.csv"\nlevel_m = 1.0', "ground.level_m: it stands beside level"),
        ('level_m = 1.0\nlevel_unit = "ft"', "ground.level_unit: it stands beside level_m"),
        ('level = "gauge.csv"\nterrain = "dem.tif"', "ground.level: it stands beside terrain"),
        ('level = "gauge.csv"\nlevel_unit = "yd"', "ground.level_unit"),
        ('level = "gauge.csv"\nlevel_zero_std_m = 0.1', "ground.level_zero_std_m: got no level_zero_m beside it"),
        ('level = "gauge.csv"\nuphill_azimuth_deg = 3.0', "ground.uphill_azimuth_deg: got no slope_deg beside it"),
        ('level = "gauge.csv"\nlevel_columns = { level = "height" }', 'level = "height", which is not there'),
        ('level = "gauge.csv"\nlevel_datum = "NN"', "ground.level_zero_m: got nothing"),
        ('level = { file = "gauge.csv", readings = [[1, 1.0, 0.1]] }', "ground.level.readings: got 1 reading"),
    ],
)
def test_a_station_says_what_is_wrong_with_its_level(tmp_path, keys, said):
    (tmp_path / "gauge.csv").write_text(rows())
    (tmp_path / "s.toml").write_text(f"{STATION}[ground]\n{keys}\n")
    with pytest.raises(ConfigError, match=re.escape(said)):
        load_station(tmp_path / "s.toml")


def test_a_slope_may_have_a_level(tmp_path):
    (tmp_path / "gauge.csv").write_text(rows())
    keys = 'slope_deg = 0.1\nuphill_azimuth_deg = 90.0\nlevel = "gauge.csv"'
    (tmp_path / "s.toml").write_text(f"{STATION}[ground]\n{keys}\n")
    pipeline = load_station(tmp_path / "s.toml").pipeline
    assert pipeline.ground is not None
    assert pipeline.level.level_m.tolist() == [0.5, 1.5, 2.5, 3.5]


def test_levels_in_the_datum_of_the_stations_altitude_need_no_zero(tmp_path):
    (tmp_path / "gauge.csv").write_text(rows())
    place = STATION + "lat_deg = 47.5\nlon_deg = 8.5\nalt_msl_m = 108.0\n"
    keys = 'level = "gauge.csv"\nlevel_datum = "EGM2008"\n'
    (tmp_path / "same.toml").write_text(f'{place}[ground]\n{keys}altitude_datum = "EGM2008"\n')
    (tmp_path / "other.toml").write_text(f"{place}[ground]\n{keys}")
    same, other = (load_station(tmp_path / f"{name}.toml") for name in ("same", "other"))
    assert [(each.pipeline.level.zero_m, each.pipeline.level.zero_std_m) for each in (same, other)] == [
        (100.0, 0.0),
        (100.0, 1.0),  # of some sea level
    ]
    (tmp_path / "gauge.csv").unlink()
    again = parse_station(resolved_toml(other).encode(), where="a recording", folder=tmp_path)
    assert again.pipeline.config_id == other.pipeline.config_id
    assert (again.pipeline.level.zero_m, again.pipeline.level.zero_std_m) == (100.0, 1.0)
    assert again.pipeline.level.datum == "EGM2008"
