import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry.mavlink import FollowedIds, MavlinkDecoder, headers
from aerodft.model import (
    NO_BOOT_TIME,
    ClockTrack,
    GimbalSource,
    GimbalTrack,
    GimbalTypeTrack,
    HeartbeatTrack,
    HeightSource,
    HeightTrack,
    LinkTrack,
    OtherSenderTrack,
    PositionTrack,
    RawBlock,
    SyncTrack,
    Track,
    VehicleTrack,
    WireProtocol,
)

Pack = Callable[..., bytes]
MakeBlock = Callable[[list[bytes]], RawBlock]

AUTOPILOT = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
GROUND_STATION = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
NAN = math.nan


def _attitude(**angles: float) -> dialect.MAVLink_message:
    values = {"roll": 0.1, "pitch": -0.2, "yaw": 0.3} | angles
    return dialect.MAVLink_attitude_message(5000, values["roll"], values["pitch"], values["yaw"], 0, 0, 0)


def _gimbal(
    flags: int, q: tuple[float, float, float, float] = (1, 0, 0, 0), failure: int = 0
) -> dialect.MAVLink_message:
    return dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 4000, flags, q, NAN, NAN, NAN, failure)


def _sensor(current_cm: int, **other: int) -> dialect.MAVLink_message:
    values = {"least": 20, "most": 6000, "orientation": 25, "covariance": 255, "quality": 0, "number": 0} | other
    return dialect.MAVLink_distance_sensor_message(
        3000,
        values["least"],
        values["most"],
        current_cm,
        0,
        values["number"],
        values["orientation"],
        values["covariance"],
        signal_quality=values["quality"],
    )


def _terrain(spacing: int, height_m: float) -> dialect.MAVLink_message:
    return dialect.MAVLink_terrain_report_message(-353_000_000, 1_490_000_000, spacing, 500.0, height_m, 0, 10)


def _besides_life(decoder: MavlinkDecoder, made: RawBlock) -> tuple[Track, ...]:
    """The tracks of what messages say, not of that there are any."""
    return tuple(
        track for track in decoder.decode(made) if not isinstance(track, HeartbeatTrack | LinkTrack | OtherSenderTrack)
    )


@pytest.fixture
def decode(pack: Pack, block: MakeBlock) -> Callable[..., tuple[Track, ...]]:
    """Decodes messages after an autopilot's heartbeat."""

    def decoded(
        *messages: dialect.MAVLink_message, decoder: MavlinkDecoder | None = None, v1: bool = False
    ) -> tuple[Track, ...]:
        frames = [pack(AUTOPILOT, v1=v1), *(pack(message, v1=v1) for message in messages)]
        return _besides_life(decoder or MavlinkDecoder(), block(frames))

    return decoded


Decode = Callable[..., tuple[Track, ...]]


@pytest.mark.parametrize(
    ("flags", "earth"),
    [
        (0, False),
        (16, True),
        (32, False),
        (32 | 16, False),
        (64, True),
        (64 | 16, True),
        (32 | 64, False),
        (44, False),
        (12, False),
        (2 | 4 | 8 | 16, False),  # PX4's, of servos
    ],
)
def test_gimbal_yaw_frame_rule(decode: Decode, *, flags: int, earth: bool) -> None:
    (track,) = decode(_gimbal(flags))
    assert isinstance(track, GimbalTrack)
    assert track.yaw_in_earth.tolist() == [earth]


def test_gimbal_rows_without_value_are_left_out_and_counted(decode: Decode) -> None:
    decoder = MavlinkDecoder()
    bad = [
        _gimbal(32, failure=1),
        _gimbal(32, failure=32 | 64),
        _gimbal(32, failure=1 << 20),
        _gimbal(32 | 1),
        _gimbal(32, (NAN, 0, 0, 0)),
        _gimbal(32, (0, 0, 0, 0)),
        _gimbal(32, (math.inf, 0, 0, 0)),
    ]
    track, *failures = decode(*bad, _gimbal(32, (0.7071, 0, -0.7071, 0), failure=512), decoder=decoder)
    assert isinstance(track, GimbalTrack)
    assert [(each.what, len(each.arrival_ns)) for each in failures] == [
        (f"the gimbal reports a failure ({what})", 1)
        for what in ("it is at its roll limit", "motor error", "software error", "an unknown one")
    ]
    np.testing.assert_allclose(track.wxyz, [[math.sqrt(0.5), 0, -math.sqrt(0.5), 0]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(track.wxyz, axis=-1), 1, atol=1e-15)
    assert decoder.rejected == {
        "GIMBAL_DEVICE_ATTITUDE_STATUS: gimbal reports a failure (it is at its roll limit)": 1,
        "GIMBAL_DEVICE_ATTITUDE_STATUS: gimbal reports a failure (motor error)": 1,
        "GIMBAL_DEVICE_ATTITUDE_STATUS: gimbal reports a failure (an unknown one)": 1,
        "GIMBAL_DEVICE_ATTITUDE_STATUS: gimbal is retracted": 1,
        "GIMBAL_DEVICE_ATTITUDE_STATUS: q is no rotation": 3,
    }


def test_of_two_gimbals_behind_one_autopilot_the_first_is_heard(decode: Decode) -> None:
    def report(device: int, pitch: float) -> dialect.MAVLink_message:
        q = (math.cos(pitch / 2), 0, math.sin(pitch / 2), 0)
        return dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 4000, 44, q, NAN, NAN, NAN, 0, gimbal_device_id=device
        )

    decoder = MavlinkDecoder()
    (track,) = decode(report(2, -0.5), report(1, -1.0), report(2, -0.5), report(1, -1.0), decoder=decoder)
    assert isinstance(track, GimbalTrack)
    np.testing.assert_allclose(track.wxyz[:, 2], math.sin(-0.25), atol=1e-6)
    assert decoder.rejected == {"GIMBAL_DEVICE_ATTITUDE_STATUS: of another gimbal than number 2": 2}


def test_mount_status_of_mavlink_1(decode: Decode) -> None:
    status = dialect.MAVLink_mount_status_message(0, 0, -6000, 500, 2000)
    (first,), (second,) = decode(status, v1=True), decode(status)
    assert isinstance(first, GimbalTrack)
    assert isinstance(second, GimbalTrack)
    np.testing.assert_array_equal(first.wxyz, second.wxyz)


def test_mount_messages(decode: Decode) -> None:
    orientation = dialect.MAVLink_mount_orientation_message(4000, 5.0, -60.0, 20.0)
    status = dialect.MAVLink_mount_status_message(0, 0, -6000, 500, 2000)
    by_source = {t.source: t for t in decode(orientation, status) if isinstance(t, GimbalTrack)}
    truth = Rotation.from_euler("ZYX", [20, -60, 5], degrees=True).as_quat(scalar_first=True)
    for source, boot_ns in ((GimbalSource.MOUNT_ORIENTATION, 4 * 10**9), (GimbalSource.MOUNT_STATUS, NO_BOOT_TIME)):
        np.testing.assert_allclose(by_source[source].wxyz, [truth], atol=1e-7)
        assert by_source[source].boot_ns.tolist() == [boot_ns]
        assert not by_source[source].yaw_in_earth.any()


def test_mount_rows_without_value(decode: Decode) -> None:
    decoder = MavlinkDecoder()
    zero = dialect.MAVLink_mount_status_message(0, 0, 0, 0, 0)
    unknown = dialect.MAVLink_mount_orientation_message(4000, 0.0, -60.0, NAN)
    assert decode(zero, unknown, decoder=decoder) == ()
    assert decoder.rejected == {
        "MOUNT_STATUS: all angles zero": 1,
        "MOUNT_ORIENTATION: yaw is no angle": 1,
    }


@pytest.mark.parametrize("field", ["roll", "pitch", "yaw"])
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, 1e30])
def test_attitude_without_value(decode: Decode, field: str, value: float) -> None:
    decoder = MavlinkDecoder()
    (track,) = decode(_attitude(**{field: value}), _attitude(), decoder=decoder)
    assert isinstance(track, VehicleTrack)
    truth = Rotation.from_euler("ZYX", [0.3, -0.2, 0.1]).as_quat(scalar_first=True)
    np.testing.assert_allclose(track.wxyz, [truth], atol=1e-7)
    assert decoder.rejected == {f"ATTITUDE: {field} is no angle": 1}


def test_clock_rows(decode: Decode) -> None:
    decoder = MavlinkDecoder()
    times_us = [0, 86_400_000_000, 1_795_221_245_168_985, 2**63]
    (track,) = decode(*(dialect.MAVLink_system_time_message(t, 77) for t in times_us), decoder=decoder)
    assert isinstance(track, ClockTrack)
    assert track.unix_ns.tolist() == [1_795_221_245_168_985_000]
    assert track.boot_ns.tolist() == [77_000_000]
    assert decoder.rejected == {"SYSTEM_TIME: no UTC yet": 2, "SYSTEM_TIME: impossible year": 1}


def test_position_rows(decode: Decode) -> None:
    rows = [(0, 0), (-353_632_621, 1_491_652_374), (0, 1_491_652_374), (2_000_000_000, 1)]
    messages = [
        dialect.MAVLink_global_position_int_message(9, lat, lon, 584_090, -120, 0, 0, 0, 65535) for lat, lon in rows
    ]
    (track,) = decode(*messages)
    assert isinstance(track, PositionTrack)
    np.testing.assert_allclose(np.degrees(track.lat_rad), [-35.3632621, 0])
    np.testing.assert_allclose(track.alt_msl_m, 584.09)
    np.testing.assert_allclose(track.height_home_m, -0.12)


def test_distance_sensor_rows(decode: Decode) -> None:
    bad = [_sensor(0), _sensor(4), _sensor(6000), _sensor(6001), _sensor(65535, most=65535), _sensor(500, quality=1)]
    decoder = MavlinkDecoder()
    (track,) = decode(
        *bad, _sensor(700, orientation=0), _sensor(500, covariance=4), _sensor(5999, covariance=0), decoder=decoder
    )
    assert isinstance(track, HeightTrack)
    assert track.source == HeightSource.RANGEFINDER
    assert track.slant
    np.testing.assert_array_equal(track.value_m, [5.0, 59.99])
    np.testing.assert_array_equal(track.std_m, [0.02, NAN])
    assert decoder.rejected.total() == len(bad) + 1
    assert decoder.rejected["DISTANCE_SENSOR: does not look down"] == 1


def test_of_two_sensors_that_look_down_the_first_is_followed(decode: Decode) -> None:
    """A forward-looking one, whoever sends it, is no such sensor."""
    decoder = MavlinkDecoder()
    sensors = [_sensor(300, number=4, orientation=0), _sensor(5000, number=1), _sensor(650, number=2), _sensor(5001)]
    (track,) = decode(*sensors, _sensor(5002, number=1), decoder=decoder)
    assert isinstance(track, HeightTrack)
    np.testing.assert_array_equal(track.value_m, [50.0, 50.02])
    assert decoder.rejected == {
        "DISTANCE_SENSOR: of another sensor than number 1": 2,
        "DISTANCE_SENSOR: does not look down": 1,
    }


def test_timesync_says_its_senders_own_time(decode: Decode) -> None:
    """In a request it is ts1, in an answer tc1; a companion's Unix time is no time since boot."""
    decoder = MavlinkDecoder()
    pairs = [(0, 5_000_000_123), (6_000_000_456, 17), (0, 1_795_221_168 * 10**9), (-5, 3)]
    (track,) = decode(*(dialect.MAVLink_timesync_message(tc1, ts1) for tc1, ts1 in pairs), decoder=decoder)
    assert isinstance(track, SyncTrack)
    assert track.boot_ns.tolist() == [5_000_000_123, 6_000_000_456]
    assert decoder.rejected == {"TIMESYNC: no time since boot": 2}


def test_rangefinder_gives_way_to_the_distance_sensor(decode: Decode) -> None:
    messages = [dialect.MAVLink_rangefinder_message(d, 0) for d in (0.0, NAN, 12.5)]
    after = dialect.MAVLink_rangefinder_message(99.0, 0)
    first, second = decode(*messages, _sensor(800), after)[::-1]
    assert isinstance(first, HeightTrack)
    assert isinstance(second, HeightTrack)
    assert first.value_m.tolist() == [12.5]
    assert first.boot_ns.tolist() == [NO_BOOT_TIME]
    assert second.value_m.tolist() == [8.0]


def test_terrain_rows(decode: Decode) -> None:
    (track,) = decode(_terrain(0, 584.0), _terrain(100, NAN), _terrain(100, 42.5))
    assert isinstance(track, HeightTrack)
    assert (track.source, track.slant) == (HeightSource.TERRAIN, False)
    assert track.value_m.tolist() == [42.5]


@pytest.mark.parametrize(
    ("terrain_m", "clearance_m", "value_m"),
    [
        (540.0, 30.0, [30.0]),
        (31.0, -1.0, [31.0]),
        (31.0, NAN, [31.0]),
        (-2000.0, -1.0, []),
        (-999.0, -1.0, []),
        (NAN, NAN, []),
    ],
)
def test_altitude_rows(decode: Decode, terrain_m: float, clearance_m: float, value_m: list[float]) -> None:
    tracks = decode(dialect.MAVLink_altitude_message(7_000_000, 0, 0, 0, 0, terrain_m, clearance_m))
    assert [v for t in tracks if isinstance(t, HeightTrack) for v in t.value_m.tolist()] == value_m
    assert all(t.boot_ns.tolist() == [7 * 10**9] for t in tracks)


@pytest.mark.parametrize(("spacing", "values_m"), [(0, [30.0]), (100, [42.5])])
def test_a_terrain_report_without_a_database_silences_no_altitude(
    decode: Decode, spacing: int, values_m: list[float]
) -> None:
    altitude = dialect.MAVLink_altitude_message(7_000_000, 0, 0, 0, 0, NAN, 30.0)
    tracks = decode(_terrain(spacing, 42.5), altitude)
    assert [v for t in tracks if isinstance(t, HeightTrack) for v in t.value_m.tolist()] == values_m


def test_the_first_vehicle_is_followed(pack: Pack, block: MakeBlock) -> None:
    frames = [
        pack(GROUND_STATION, system=255, component=190),
        pack(_attitude(), system=9, component=154),  # a gimbal's own attitude
        pack(_attitude(), system=3),
        pack(_attitude(), system=4),
        pack(_attitude(), system=3, component=154),
        pack(_attitude(), system=3),
    ]
    decoder = MavlinkDecoder()
    (track,) = _besides_life(decoder, block(frames))
    assert decoder.system == 3
    assert track.arrival_ns.tolist() == [10**18 + 2 * 10**6, 10**18 + 5 * 10**6]
    chosen = MavlinkDecoder(FollowedIds(system=4))
    assert len(_besides_life(chosen, block(frames))[0].arrival_ns) == 1


def test_a_gimbal_with_a_clock_of_its_own_has_no_boot_time(pack: Pack, block: MakeBlock) -> None:
    frames = [pack(AUTOPILOT), pack(_gimbal(32), component=154), pack(_gimbal(64), component=1)]
    (track,) = _besides_life(MavlinkDecoder(), block(frames))
    assert isinstance(track, GimbalTrack)
    assert track.boot_ns.tolist() == [NO_BOOT_TIME]
    assert track.yaw_in_earth.tolist() == [False]  # the second sender of the same message is not mixed in


def test_damaged_frames_are_left_out(pack: Pack, block: MakeBlock) -> None:
    broken = bytearray(pack(_attitude()))
    broken[12] ^= 4
    decoder = MavlinkDecoder()
    made = block([pack(AUTOPILOT), bytes(broken), pack(_attitude())[:-5], b"\xfd", b"", pack(_attitude())])
    (track,) = _besides_life(decoder, made)
    assert len(track.arrival_ns) == 1
    assert np.count_nonzero(headers(made)[0] < 0) == 4
    outside = replace(made, offset=made.offset + 10**6)
    assert decoder.decode(outside) == ()


def test_another_protocol_is_a_broken_contract(block: MakeBlock) -> None:
    with pytest.raises(ValueError, match="must be mavlink"):
        MavlinkDecoder().decode(replace(block([b"x" * 20]), protocol=WireProtocol.DATAFLASH))


def _information(model: bytes, device: int = 0) -> dialect.MAVLink_message:
    return dialect.MAVLink_gimbal_device_information_message(
        1000, b"maker", model, b"", 1, 1, 1, 7, 0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, gimbal_device_id=device
    )


def _managed(abilities: int, device: int = 1) -> dialect.MAVLink_message:
    return dialect.MAVLink_gimbal_manager_information_message(1000, abilities, device, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0)


@pytest.mark.parametrize(("one", "two"), [(_information(b"one"), _information(b"two")), (_managed(1), _managed(2))])
def test_a_gimbal_says_which_one_it_is(
    decode: Decode, one: dialect.MAVLink_message, two: dialect.MAVLink_message
) -> None:
    (track,) = decode(AUTOPILOT, one, one, two)
    assert isinstance(track, GimbalTypeTrack)
    assert np.unique(track.identity, return_index=True)[1].tolist() in ([0, 2], [2, 0])


def test_a_gimbal_that_tilts_may_say_that_it_cannot_roll(decode: Decode) -> None:
    (track,) = decode(_managed(32), _managed(32 | 4), _managed(0))
    assert isinstance(track, GimbalTypeTrack)
    assert track.cannot_roll.tolist() == [True, False, False]


@pytest.mark.parametrize("gimbal", [None, 1, 2])
def test_two_gimbals_of_one_autopilot_are_not_one_that_changes(decode: Decode, gimbal: int | None) -> None:
    said = [_information(b"one", 1), _information(b"two", 2), _managed(1, 1), _managed(2, 2)] * 3
    decoder = MavlinkDecoder(FollowedIds(gimbal=gimbal))
    tracks = decode(*said, decoder=decoder)
    alone = decode(*said[gimbal - 1 if gimbal else 0 :: 2][:2])
    assert {track.message: track.identity.tolist() for track in tracks} == {
        track.message: track.identity.tolist() * 3 for track in alone
    }
    assert not decoder.rejected


def test_an_autopilot_speaks_for_a_gimbal_that_is_a_component(decode: Decode) -> None:
    said = [_managed(1, 154), _managed(2, 171)] * 3
    (track,) = decode(*said, decoder=MavlinkDecoder(FollowedIds(gimbal=171)))
    (alone,) = decode(_managed(2, 171))
    assert track.identity.tolist() == alone.identity.tolist() * 3


@pytest.mark.parametrize(("gimbal", "model"), [(None, b"one"), (154, b"one"), (171, b"two")])
def test_a_chosen_gimbal_alone_says_which_one_it_is(
    decode: Decode, pack: Pack, block: MakeBlock, gimbal: int | None, model: bytes
) -> None:
    said = [pack(_information(b"one"), component=154), pack(_information(b"two"), component=171)] * 3
    (track,) = _besides_life(MavlinkDecoder(FollowedIds(gimbal=gimbal)), block([pack(AUTOPILOT), *said]))
    (alone,) = decode(_information(model))
    assert track.identity.tolist() == alone.identity.tolist() * 3
