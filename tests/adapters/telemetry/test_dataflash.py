import os
import struct
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import DFReader
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry import CompositeDecoder
from aerodft.adapters.telemetry.dataflash import DataflashDecoder, DataflashSource, gps_to_unix_ns
from aerodft.model import ClockTrack, GimbalTrack, HeightTrack, PositionTrack, RawBlock, Track, VehicleTrack
from tests.nights import at_night
from tests.pymavlink_logs import messages_by_pymavlink

USED = ("GPS", "ATT", "MNT", "POS", "RFND", "TERR")


@pytest.fixture(scope="module")
def cut_log(data_folder: Path) -> Path:
    """A flight's on-board log, cut short."""
    return data_folder / "sitl/brushless_cut.BIN"


@pytest.fixture(scope="module")
def theirs(cut_log: Path) -> dict[str, list[Any]]:
    """Messages by pymavlink, by type; ``*`` all of them."""
    log = DFReader.DFReader_binary(str(cut_log), zero_time_base=False)
    found: dict[str, list[Any]] = defaultdict(list)
    while (message := log.recv_msg()) is not None:
        found["*"].append(message.get_type())
        if message.get_type() in USED:
            found[message.get_type()].append(message)
    log.filehandle.close()
    log.data_map.close()
    return found


def _blocks(path: Path) -> list[RawBlock]:
    return [event for event in DataflashSource(path).events() if isinstance(event, RawBlock)]


def _tracks(blocks: list[RawBlock], kind: type[Track]) -> dict[str, Any]:
    """Fields of our tracks of one kind, joined, by source."""
    decoder = DataflashDecoder()
    columns: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for block in blocks:
        for track in decoder.decode(block):
            if isinstance(track, kind):
                for cls in type(track).__mro__:
                    for name in getattr(cls, "__slots__", ()):
                        columns[str(getattr(track, "source", ""))][name].append(getattr(track, name))
    return {
        source: {n: np.concatenate(c) if isinstance(c[0], np.ndarray) else c[0] for n, c in fields.items()}
        for source, fields in columns.items()
    }


def test_the_same_messages_as_pymavlink(cut_log: Path, theirs: dict[str, list[Any]]) -> None:
    blocks, decoder = _blocks(cut_log), DataflashDecoder()
    kinds = [block.data[at + 2] for block in blocks for at in block.offset.tolist()]
    for block in blocks:
        decoder.decode(block)
    assert [decoder.formats[kind].name if kind != 128 else "FMT" for kind in kinds] == theirs["*"]


def test_clock(cut_log: Path, theirs: dict[str, list[Any]]) -> None:
    clock = _tracks(_blocks(cut_log), ClockTrack)[""]
    good = [m for m in theirs["GPS"] if m.Status >= 3]
    unix_s = [315964800 + m.GWk * 604800 + m.GMS * 1e-3 - 18 for m in good]
    np.testing.assert_allclose(clock["unix_ns"] / 1e9, unix_s, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(clock["boot_ns"], [m.TimeUS * 1000 for m in good])


def test_attitudes(cut_log: Path, theirs: dict[str, list[Any]]) -> None:
    blocks = _blocks(cut_log)
    for kind, source, message, yaw in ((VehicleTrack, "", "ATT", "Yaw"), (GimbalTrack, "MNT", "MNT", "YawB")):
        ours = _tracks(blocks, kind)[source]
        angles_deg = [(getattr(m, yaw), m.Pitch, m.Roll) for m in theirs[message]]
        truth = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_quat(scalar_first=True)
        sign = np.sign(np.sum(ours["wxyz"] * truth, axis=-1, keepdims=True))
        np.testing.assert_allclose(ours["wxyz"] * sign, truth, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(ours["boot_ns"], [m.TimeUS * 1000 for m in theirs[message]])


def test_positions_and_heights(cut_log: Path, theirs: dict[str, list[Any]]) -> None:
    blocks = _blocks(cut_log)
    position = _tracks(blocks, PositionTrack)[""]
    fixes = [m for m in theirs["POS"] if m.Lat or m.Lng]
    np.testing.assert_allclose(np.degrees(position["lat_rad"]), [m.Lat for m in fixes], rtol=1e-15)
    np.testing.assert_allclose(np.degrees(position["lon_rad"]), [m.Lng for m in fixes], rtol=1e-15)
    np.testing.assert_array_equal(position["alt_msl_m"], [m.Alt for m in fixes])
    np.testing.assert_array_equal(position["height_home_m"], [m.RelHomeAlt for m in fixes])
    heights = _tracks(blocks, HeightTrack)
    down = [m for m in theirs["RFND"] if m.Stat == 4 and m.Orient == 25]
    np.testing.assert_array_equal(heights["rangefinder"]["value_m"], [m.Dist for m in down])
    assert heights["rangefinder"]["slant"]
    terrain = [m for m in theirs["TERR"] if m.Status == 2 and m.Spacing]
    np.testing.assert_array_equal(heights["terrain"]["value_m"], [m.CHeight for m in terrain])
    assert not heights["terrain"]["slant"]


def test_arrival_is_utc_and_does_not_decrease(cut_log: Path) -> None:
    blocks = _blocks(cut_log)
    arrival_ns = np.concatenate([block.arrival_ns for block in blocks])
    assert (np.diff(arrival_ns) >= 0).all()
    clock = _tracks(blocks, ClockTrack)[""]
    assert np.abs(clock["arrival_ns"] - clock["unix_ns"]).max() < 0.3e9


def test_the_cut_is_said(cut_log: Path) -> None:
    source = DataflashSource(cut_log)
    list(source.events())
    assert [sentence for sentence in source.warnings() if "cut off" in sentence]
    assert source.counts.truncated == 1


def test_tracks_do_not_depend_on_how_messages_are_cut(cut_log: Path, tmp_path: Path) -> None:
    head = tmp_path / "head.bin"
    head.write_bytes(cut_log.read_bytes()[:700_000])
    blocks = _blocks(head)
    pieces = [b.rows(slice(k, k + 97)) for b in blocks for k in range(0, len(b.offset), 97)]
    for kind in (VehicleTrack, GimbalTrack, PositionTrack, HeightTrack, ClockTrack):
        whole, cut = _tracks(blocks, kind), _tracks(pieces, kind)
        assert whole.keys() == cut.keys()
        for source, fields in whole.items():
            for name, values in fields.items():
                np.testing.assert_array_equal(cut[source][name], values)


def test_damage_in_the_middle_costs_few_messages(cut_log: Path, tmp_path: Path) -> None:
    content = bytearray(cut_log.read_bytes()[:1_000_000])
    path = tmp_path / "damaged.bin"
    path.write_bytes(content)
    whole = sum(len(b.offset) for b in _blocks(path))
    content[500_000:500_200] = bytes(200)
    path.write_bytes(content)
    source = DataflashSource(path)
    assert 0 < whole - sum(len(b.offset) for b in source.events() if isinstance(b, RawBlock)) < 30
    assert source.counts.skipped_bytes < 600


def _message(kind: int, payload: bytes) -> bytes:
    return bytes((0xA3, 0x95, kind)) + payload


def _fmt(kind: int, size: int, name: bytes, codes: bytes, columns: bytes) -> bytes:
    return _message(128, struct.pack("<BB4s16s64s", kind, size + 3, name, codes, columns))


def test_a_second_flight_in_the_file_has_its_own_layouts(tmp_path: Path) -> None:
    path = tmp_path / "two.bin"
    first = _fmt(10, 20, b"ATT", b"Qfff", b"TimeUS,Roll,Pitch,Yaw") + _message(10, struct.pack("<Qfff", 1, 10.0, 0, 0))
    again = _fmt(10, 20, b"ATT", b"Qfff", b"TimeUS,Yaw,Roll,Pitch") + _message(10, struct.pack("<Qfff", 2, 0, 20.0, 0))
    path.write_bytes(first + again)
    (block,) = _blocks(path)
    tracks = DataflashDecoder().decode(block)
    rolls_deg = [Rotation.from_quat(each.wxyz[0], scalar_first=True).magnitude() * 180 / np.pi for each in tracks]
    np.testing.assert_allclose(rolls_deg, [10, 20])


def test_a_log_without_gps_takes_the_files_time(tmp_path: Path) -> None:
    path = tmp_path / "indoor.bin"
    rows = [_message(10, struct.pack("<Qfff", 2_000_000 + k * 100_000, 1.0, 2.0, 3.0)) for k in range(11)]
    path.write_bytes(_fmt(10, 20, b"ATT", b"Qfff", b"TimeUS,Roll,Pitch,Yaw") + b"".join(rows))
    os.utime(path, (1_600_000_000, 1_600_000_000))
    source = DataflashSource(path)
    (block,) = source.events()
    assert isinstance(block, RawBlock)
    assert int(block.arrival_ns[-1]) == 1_600_000_000 * 10**9
    assert int(block.arrival_ns[0]) == int(block.arrival_ns[1]) == 1_599_999_999 * 10**9
    assert any("no GPS time" in sentence for sentence in source.warnings())
    (track,) = CompositeDecoder().decode(block)
    assert isinstance(track, VehicleTrack)
    assert len(track.arrival_ns) == 11


def test_rows_without_value_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "nan.bin"
    rows = [_message(10, struct.pack("<QBfff", k + 1, k == 2, 0.0, -30.0, yaw)) for k, yaw in enumerate([np.nan, 5, 6])]
    path.write_bytes(_fmt(10, 21, b"MNT", b"QBfff", b"TimeUS,I,Roll,Pitch,YawB") + b"".join(rows))
    decoder = DataflashDecoder()
    (track,) = decoder.decode(_blocks(path)[0])
    assert track.boot_ns.tolist() == [2000]
    assert decoder.rejected == {"MNT: another instance": 1, "MNT: YawB is no angle": 1}


def test_leap_seconds_of_their_time() -> None:
    # 2016-07-01 00:00:00 UTC was GPS week 1903, second 432017; 2020-01-01 00:00:00 UTC was week 2086, second 259218.
    unix_ns = gps_to_unix_ns(np.array([1903, 2086]), np.array([432_017_000, 259_218_000]))
    assert unix_ns.tolist() == [1_467_331_200 * 10**9, 1_577_836_800 * 10**9]


_PARM = _fmt(11, 28, b"PARM", b"QNf", b"TimeUS,Name,Value")
_RFND = _fmt(12, 15, b"RFND", b"QBfBB", b"TimeUS,Instance,Dist,Stat,Orient")


def _parameter(time_us: int, name: bytes, value: float) -> bytes:
    return _message(11, struct.pack("<Q16sf", time_us, name, value))


def _reading(time_us: int, distance_m: float, *, sensor: int = 0, status: int = 4, orientation: int = 25) -> bytes:
    return _message(12, struct.pack("<QBfBB", time_us, sensor, distance_m, status, orientation))


def _seen_m(path: Path, messages: list[bytes]) -> tuple[list[float], dict[str, int]]:
    """Heights, and what was left out of a log of these messages, whole as in pieces of one."""
    path.write_bytes(_PARM + _RFND + b"".join(messages))
    (block,) = _blocks(path)
    found = []
    for pieces in ([block], [block.rows(slice(k, k + 1)) for k in range(len(block.offset))]):
        decoder = DataflashDecoder()
        heights = [track for piece in pieces for track in decoder.decode(piece) if isinstance(track, HeightTrack)]
        found.append((np.concatenate([each.value_m for each in heights]).round(3).tolist(), dict(decoder.rejected)))
    assert found[0] == found[1]
    return found[0]


@pytest.mark.parametrize(
    ("least", "most", "per_m"), [(b"RNGFND1_MIN", b"RNGFND1_MAX", 1), (b"RNGFND1_MIN_CM", b"RNGFND1_MAX_CM", 100)]
)
def test_a_rangefinder_is_believed_within_the_limits_that_the_log_states(
    tmp_path: Path, least: bytes, most: bytes, per_m: int
) -> None:
    messages = [
        _reading(1, 0.1),  # before anything is known of its limits
        _parameter(2, least, 0.25 * per_m),
        _parameter(3, most, 40.0 * per_m),
        _parameter(4, most.replace(b"1", b"2"), 5.0 * per_m),  # of another sensor
        *(_reading(10 + k, metres) for k, metres in enumerate([0.1, 0.3, 39.9, 40.0, 65.0])),
        _parameter(20, most, 100.0 * per_m),
        _reading(21, 65.0),
    ]
    heights_m, rejected = _seen_m(tmp_path / "limits.bin", messages)
    assert heights_m == [0.1, 0.3, 39.9, 65.0]
    assert rejected == {"RFND: below the sensor's minimum": 1, "RFND: at the sensor's maximum or above": 2}


def test_readings_of_two_rangefinders_are_not_mixed(tmp_path: Path) -> None:
    messages = [
        _reading(1, 3.0, sensor=2, orientation=0),
        _reading(2, 9.0, sensor=1, status=1),
        _reading(3, 20.0),
        _reading(4, 21.5, sensor=1),
        _reading(5, 20.2),
    ]
    heights_m, rejected = _seen_m(tmp_path / "two.bin", messages)
    assert heights_m == [20.0, 20.2]
    assert rejected == {
        "RFND: does not look down": 1,
        "RFND: status is not good": 1,
        "RFND: of another sensor than number 0": 1,
    }


@pytest.mark.parametrize("codes", [b"Qnff", b"nnfff", b"fffff"])
def test_a_field_that_is_text_where_a_number_belongs_is_no_message_of_ours(tmp_path: Path, codes: bytes) -> None:
    path = tmp_path / "text.bin"
    columns = b"TimeUS,Roll,Pitch,Yaw" if len(codes) == 4 else b"TimeUS,Other,Roll,Pitch,Yaw"
    path.write_bytes(_fmt(10, 20, b"ATT", codes, columns) + _message(10, b"abcd" * 5))
    assert [DataflashDecoder().decode(block) for block in _blocks(path)] == [()]


def _flight(seed: int) -> list[bytes]:
    """Messages of a log: formats first, then attitudes, gimbal angles and others with random numbers."""
    rng = np.random.default_rng(seed)
    layouts = {
        10: (b"ATT", b"Qfff", b"TimeUS,Roll,Pitch,Yaw"),
        11: (b"MNT", b"QBfff", b"TimeUS,I,Roll,Pitch,YawB"),
        12: (b"IMU", b"Qffffff", b"TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        13: (b"FILE", b"NB", b"FileName,Length"),
    }
    sizes = {b"Q": 8, b"B": 1, b"f": 4, b"N": 16}
    messages = [
        _fmt(kind, sum(sizes[bytes([code])] for code in codes), name, codes, columns)
        for kind, (name, codes, columns) in layouts.items()
    ]
    for k in range(4000):
        kind, time_us = (10, 11, 12, 13)[rng.choice(4, p=[0.3, 0.3, 0.35, 0.05])], 5_000_000 + 2500 * k
        angles = struct.pack("<fff", *rng.uniform(-90, 90, 3))
        payload = {
            10: struct.pack("<Q", time_us) + angles,
            11: struct.pack("<QB", time_us, 0) + angles,
            12: struct.pack("<Q", time_us) + rng.standard_normal(6).astype("<f4").tobytes(),
            13: struct.pack("<16sB", b"@SYS/log", k % 256),
        }
        messages.append(_message(kind, payload[kind]))
    return messages


def _read_by_pymavlink(path: Path) -> Counter[bytes]:
    data = path.read_bytes()
    return Counter(data[start:end] for start, end in messages_by_pymavlink(path))


def _read(path: Path) -> tuple[Counter[bytes], Counter[bytes]]:
    """The whole messages found, and those that may be damaged."""
    blocks, decoder = _blocks(path), DataflashDecoder()
    for block in blocks:
        decoder.decode(block)
    sizes = {128: 89, **{kind: layout.dtype.itemsize + 3 for kind, layout in decoder.formats.items()}}
    whole, doubtful = Counter[bytes](), Counter[bytes]()
    for b in blocks:
        for at, length in zip(b.offset.tolist(), b.length.tolist(), strict=True):
            size = sizes[b.data[at + 2]]
            (whole if length == size else doubtful)[b.data[at : at + size]] += 1
    return whole, doubtful


@pytest.mark.parametrize("share", [*at_night(0.02), 0.2])
@pytest.mark.parametrize("kind", ["cut", "flipped", "noise", "zeros"])
def test_damage_costs_no_more_than_with_pymavlink_and_invents_nothing(kind: str, share: float, tmp_path: Path) -> None:
    """Messages cut short, or with one bit flipped, which only the message itself can lose, or before foreign bytes."""
    path, lost, theirs_lost, invented, cuts = tmp_path / "damaged.bin", 0, 0, 0, 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        stream, intact, damaged = [], Counter[bytes](), Counter[bytes]()
        for message in _flight(seed):
            if message[2] == 128 or rng.random() > share:
                stream.append(message)
                intact[message] += 1
                continue
            broken = bytearray(message[: rng.integers(1, len(message))] if kind == "cut" else message)
            if kind in {"noise", "zeros"}:
                intact[message] += 1
                size = int(rng.integers(1, 300))
                broken += rng.bytes(size) if kind == "noise" else bytes(size)
            if kind == "flipped":
                broken[rng.integers(len(broken))] ^= 1 << int(rng.integers(8))
                damaged[bytes(broken)] += 1
            stream.append(bytes(broken))
            cuts += 1
        path.write_bytes(b"".join(stream))
        whole, doubtful = _read(path)
        lost += (intact - whole - doubtful).total()
        theirs_lost += (intact - _read_by_pymavlink(path)).total()
        invented += (whole - intact - damaged).total()
    print(f"\n{kind}, {cuts} messages: {lost} intact ones lost (pymavlink {theirs_lost}), {invented} invented")
    assert lost == 0
    assert invented <= (1e-3 * cuts if kind == "cut" else 0)  # what is left of a head may fill one that lost a byte


def test_one_flipped_bit_of_two_times_side_by_side_is_no_gap(tmp_path: Path) -> None:
    """A day between two whole messages is: an autopilot's time goes on while nothing is logged."""
    path, messages, day_us = tmp_path / "flipped.bin", [m for m in _flight(0) if m[2] != 13], 86_400_000_000
    for k in (2000, 2001, *range(3000, len(messages))):
        time_us = struct.unpack_from("<Q", messages[k], 3)[0]
        later_us = time_us + day_us if k >= 3000 else time_us ^ 1 << 43
        messages[k] = messages[k][:3] + struct.pack("<Q", later_us) + messages[k][11:]
    path.write_bytes(b"".join(messages))
    whole, doubtful = _read(path)
    assert doubtful == Counter(messages[2000:2002])
    assert whole + doubtful == Counter(messages)


@pytest.mark.parametrize("is_noise", [False, True])
def test_lost_sectors_of_a_card_invent_no_message(tmp_path: Path, *, is_noise: bool) -> None:
    """A message that ends in a bad sector is none; one that ends where the sector begins is whole."""
    path, sector, rng, messages = tmp_path / "sectors.bin", 512, np.random.default_rng(3), _flight(3)
    data, ends = bytearray(b"".join(messages)), np.cumsum([len(message) for message in messages])
    bad = rng.choice(np.arange(3, len(data) // sector), 40, replace=False)
    for each in bad.tolist():
        data[each * sector : (each + 1) * sector] = rng.bytes(sector) if is_noise else bytes(sector)
    path.write_bytes(data)
    is_whole = ~(np.isin((ends - 1) // sector, bad) | np.isin((ends - [len(m) for m in messages]) // sector, bad))
    intact = Counter(message for message, whole in zip(messages, is_whole, strict=True) if whole)
    whole, doubtful = _read(path)
    assert (whole - intact).total() == 0
    assert (intact - whole - doubtful).total() == 0
    assert (_read_by_pymavlink(path) - intact).total() > len(bad) / 2


@pytest.mark.parametrize("is_noise", [False, True])
def test_overwritten_bytes_of_a_flight_reach_no_track(cut_log: Path, tmp_path: Path, *, is_noise: bool) -> None:
    """In 150 places of a real log, more bytes than a message has: what they do not meet is found."""
    path, rng, data = (
        tmp_path / "overwritten.bin",
        np.random.default_rng(5),
        bytearray(cut_log.read_bytes()[:2_000_000]),
    )
    path.write_bytes(data)
    blocks, decoder = _blocks(path), DataflashDecoder()
    for block in blocks:
        decoder.decode(block)
    messages = [b.data[o : o + n] for b in blocks for o, n in zip(b.offset, b.length, strict=True)]
    is_bad = np.zeros(len(data), dtype=np.bool_)
    for at in rng.integers(300_000, len(data) - 600, 150).tolist():
        size = int(rng.integers(256, 600))
        is_bad[at : at + size] = True
        data[at : at + size] = rng.bytes(size) if is_noise else bytes(size)
    path.write_bytes(data)
    ends, bad_before = np.cumsum([len(m) for m in messages]), np.append(0, np.cumsum(is_bad))
    is_hit = bad_before[ends] > bad_before[ends - [len(m) for m in messages]]
    intact = Counter(message for message, hit in zip(messages, is_hit, strict=True) if not hit)
    (whole, doubtful), logged = _read(path), Counter(messages)
    lost, invented, theirs = intact - whole - doubtful, whole - logged, _read_by_pymavlink(path) - logged
    print(f"\n{len(intact)}: {lost.total()} lost, {invented.total()} invented (pymavlink {theirs.total()})")
    assert not lost
    assert not [message for message in invented if decoder.formats[message[2]].name in USED]
    assert invented.total() <= 0.02 * theirs.total()


def test_angles_of_messages_cut_short_reach_no_track(tmp_path: Path) -> None:
    path, rng = tmp_path / "cut.bin", np.random.default_rng(8)
    messages = _flight(8)
    stays = rng.random(len(messages)) > 0.1
    stays[:4] = True
    path.write_bytes(b"".join(m if s else m[: rng.integers(1, len(m))] for m, s in zip(messages, stays, strict=True)))
    for kind, number, start in ((VehicleTrack, 10, 11), (GimbalTrack, 11, 12)):
        (track,) = _tracks(_blocks(path), kind).values()
        sent = [m for m, s in zip(messages, stays, strict=True) if s and m[2] == number]
        angles = np.array([struct.unpack_from("<fff", m, start) for m in sent])
        truth = Rotation.from_euler("ZYX", angles[:, ::-1], degrees=True).as_quat(scalar_first=True)
        assert track["boot_ns"].tolist() == [struct.unpack_from("<Q", m, 3)[0] * 1000 for m in sent]
        np.testing.assert_allclose(np.abs(np.sum(track["wxyz"] * truth, axis=-1)), 1.0, atol=1e-9)
