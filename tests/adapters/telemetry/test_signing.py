import hashlib
import logging
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from aerodft.adapters.telemetry import SignatureCheck, SigningState, load_key
from aerodft.adapters.telemetry.mavlink import StreamFramer
from aerodft.adapters.telemetry.mavlink.signing import (
    FUTURE,
    OLD,
    REPLAYED,
    UNSIGNED,
    WRONG,
    open_signing,
    sign,
    signing_time,
)
from aerodft.errors import ConfigError, InputError
from aerodft.service import SigningSettings

KEY = bytes(range(32))
NOW_NS = 1_795_000_000 * 10**9
MINUTE = 6_000_000
ATTITUDE_CRC_EXTRA = 39

Peer = Callable[..., dialect.MAVLink]


@pytest.fixture
def peer() -> Peer:
    """A signing sender, pymavlink's: ``peer(key=KEY, stamp=now, system=1, component=1, link_id=0)``."""

    def made(
        key: bytes = KEY, stamp: int = signing_time(NOW_NS), system: int = 1, component: int = 1, link_id: int = 0
    ) -> dialect.MAVLink:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        mav.signing.timestamp, mav.signing.link_id = stamp, link_id
        return mav

    return made


def attitudes(mav: dialect.MAVLink, count: int) -> list[bytes]:
    return [bytes(dialect.MAVLink_attitude_message(k, 0.1, 0.2, 0.3, 0, 0, 0).pack(mav)) for k in range(count)]


@pytest.fixture
def check() -> SignatureCheck:
    return SignatureCheck(KEY, SigningState(), lambda: NOW_NS)


def test_time_stamps_count_from_2015() -> None:
    unix_s = 1_795_000_000.0
    pymavlinks = int((unix_s - 1420070400) * 100 * 1000)  # as its setup_signing has it
    assert signing_time(int(unix_s * 1e9)) == pymavlinks
    assert signing_time(0) == 0


def test_what_pymavlink_signs_is_believed(check: SignatureCheck, peer: Peer) -> None:
    frames = attitudes(peer(), 300)
    assert check.passed(frames) == frames
    assert (check.counts.verified, check.counts.refused) == (300, {})


def test_pymavlink_believes_what_is_signed_here(check: SignatureCheck) -> None:
    theirs = dialect.MAVLink(None)
    theirs.signing.secret_key, theirs.signing.timestamp = KEY, signing_time(NOW_NS)
    plain = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    for k in range(5):
        frame = check.sign(attitudes(plain, 1)[0])
        message = theirs.decode(bytearray(frame))
        assert (message.get_type(), theirs.signing.goodsig_count) == ("ATTITUDE", k + 1)
        assert StreamFramer().push(frame) == [frame]
        assert check.passed([frame]) == []  # an echo of what was sent here is no news
    assert check.counts.refused == {REPLAYED: 5}


def test_only_unsigned_mavlink_2_can_be_signed(pack: Callable[..., bytes], peer: Peer) -> None:
    message = dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0)
    for frame in (pack(message, v1=True), attitudes(peer(), 1)[0]):
        with pytest.raises(ValueError, match="only an unsigned MAVLink 2 frame"):
            sign(frame, KEY, link_id=0, stamp=1)


@given(st.integers(1, 25) | st.integers(-13, -1), st.integers(0, 7))
def test_no_byte_of_a_signed_frame_may_change(at: int, bit: int) -> None:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = KEY, True, signing_time(NOW_NS)
    forged = bytearray(attitudes(mav, 1)[0])
    forged[at] ^= 1 << bit
    body = bytes(forged[1:-15])
    forged[-15:-13] = x25crc(body + bytes([ATTITUDE_CRC_EXTRA])).crc.to_bytes(2, "little")
    check = SignatureCheck(KEY, SigningState(), lambda: NOW_NS)
    assert check.passed([bytes(forged)]) == []
    mav.signing.timestamp = signing_time(NOW_NS)
    assert len(check.passed(attitudes(mav, 1))) == 1  # and the forged one has left nothing behind


def test_every_reason_has_its_counter(check: SignatureCheck, peer: Peer, pack: Callable[..., bytes]) -> None:
    now = signing_time(NOW_NS)
    genuine = attitudes(peer(), 3)
    check.passed(genuine)
    plain = pack(dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0))
    old_v1 = pack(dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0), v1=True)
    assert check.passed([plain, old_v1]) == []
    assert check.passed(attitudes(peer(key=bytes(32)), 2)) == []
    assert check.passed(genuine) == []
    assert check.passed(attitudes(peer(stamp=now - MINUTE - 10, component=2), 1)) == []
    assert check.passed(attitudes(peer(stamp=now + MINUTE + 10, component=2), 1)) == []
    assert check.passed(attitudes(peer(stamp=now + MINUTE + 10), 1)) == []
    assert check.counts.refused == {UNSIGNED: 2, WRONG: 2, REPLAYED: 3, OLD: 1, FUTURE: 2}


def test_a_new_sender_may_be_up_to_a_minute_behind_or_ahead(check: SignatureCheck, peer: Peer) -> None:
    now = signing_time(NOW_NS)
    for component, stamp in ((2, now - MINUTE + 10), (3, now + MINUTE)):
        assert len(check.passed(attitudes(peer(stamp=stamp, component=component), 1))) == 1


def test_a_known_sender_may_fall_behind_the_clock(peer: Peer) -> None:
    time_ns = [NOW_NS]
    check = SignatureCheck(KEY, SigningState(), lambda: time_ns[0])
    slow = peer()  # pymavlink counts messages, not seconds
    assert len(check.passed(attitudes(slow, 5))) == 5
    time_ns[0] += 3600 * 10**9
    assert len(check.passed(attitudes(slow, 5))) == 5


def test_links_and_components_have_time_stamps_of_their_own(check: SignatureCheck, peer: Peer) -> None:
    ahead = attitudes(peer(stamp=signing_time(NOW_NS) + 1000), 1)
    others = [attitudes(peer(component=2), 1)[0], attitudes(peer(link_id=1), 1)[0], attitudes(peer(system=2), 1)[0]]
    assert check.passed(ahead + others) == ahead + others


def test_listed_messages_pass_unsigned(pack: Callable[..., bytes], tmp_path: Path) -> None:
    radio = pack(dialect.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7), system=51, component=68)
    (tmp_path / "key").write_text("passphrase")
    check = open_signing(SigningSettings(key_file=tmp_path / "key"), lambda: NOW_NS)
    assert check.passed([radio]) == [radio]
    assert (check.counts.unsigned, check.counts.refused) == (1, {})
    check.close()
    strict = SigningSettings(key_file=tmp_path / "key", accept_unsigned=())
    check = open_signing(strict, lambda: NOW_NS)
    assert check.passed([radio]) == []
    check.close()


def test_own_time_stamps_go_on_after_those_heard(check: SignatureCheck, peer: Peer) -> None:
    fast = signing_time(NOW_NS) + MINUTE
    check.passed(attitudes(peer(stamp=fast), 1))
    own = check.sign(attitudes(dialect.MAVLink(None, srcSystem=255, srcComponent=190), 1)[0])
    assert int.from_bytes(own[-12:-6], "little") == fast + 1


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (KEY.hex(), KEY),
        (KEY.hex().upper() + "\r\n", KEY),
        (f"  {KEY.hex()} \n", KEY),
        ("correct horse\n", hashlib.sha256(b"correct horse").digest()),  # as MAVProxy does
        ("grün", hashlib.sha256("grün".encode()).digest()),
    ],
)
def test_key_files(tmp_path: Path, text: str, key: bytes) -> None:
    path = tmp_path / "vehicle.key"
    path.write_text(text, encoding="utf-8", newline="")
    assert load_key(path) == key


@pytest.mark.parametrize(
    ("content", "got"),
    [(b"", "nothing"), (b" \n", "nothing"), (b"\xff\xfe\x00", "binary"), (b"ab" * 31, "62 hex"), (b"x" * 5000, "more")],
)
def test_what_is_no_key(tmp_path: Path, content: bytes, got: str) -> None:
    path = tmp_path / "vehicle.key"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as refusal:
        load_key(path)
    assert got in refusal.value.got
    assert str(path) in str(refusal.value)


def test_a_key_that_others_can_read_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "vehicle.key"
    path.write_text("a long passphrase")
    path.chmod(0o644)
    load_key(path)
    assert "chmod 600" in caplog.text
    caplog.clear()
    path.chmod(0o600)
    load_key(path)
    assert not caplog.text


def test_missing_key_and_unknown_message(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read the signing key"):
        load_key(tmp_path / "none")
    with pytest.raises(ConfigError, match="RADIO_STATIS"):
        open_signing(SigningSettings(key_file=tmp_path / "none", accept_unsigned=("RADIO_STATIS",)), lambda: 0)


def test_time_stamps_survive_a_restart_and_a_kill(tmp_path: Path, peer: Peer) -> None:
    path = tmp_path / "state"
    mav = peer()
    first = SignatureCheck(KEY, SigningState.open(path, KEY), lambda: NOW_NS)
    seen = attitudes(mav, 20)
    assert first.passed(seen) == seen
    first.commit()
    killed = path.read_bytes()  # what a killed process leaves
    first.close()
    path.write_bytes(killed)
    second = SignatureCheck(KEY, SigningState.open(path, KEY), lambda: NOW_NS)
    fresh = attitudes(mav, 20)
    assert second.passed(seen) == []
    assert second.passed(fresh) == fresh
    second.close()
    assert path.stat().st_mode & 0o077 == 0


def test_what_is_new_is_written_soon(tmp_path: Path) -> None:
    path = tmp_path / "state"
    state = SigningState.open(path, KEY)
    for stamp in (1, 2):
        state.note((1, 1, 0), stamp)
        until = time.monotonic() + 5
        while f'"1/1/0":{stamp}'.encode() not in path.read_bytes() and time.monotonic() < until:
            state.commit()
        assert f'"1/1/0":{stamp}'.encode() in path.read_bytes()
    state.close()


def test_another_key_starts_anew(tmp_path: Path) -> None:
    path = tmp_path / "state"
    state = SigningState.open(path, KEY)
    state.note((1, 1, 0), 99)
    state.close()
    again, other = SigningState.open(path, KEY), bytes(32)
    assert (again.streams, again.latest) == ({(1, 1, 0): 99}, 99)
    again.close()
    changed = SigningState.open(path, other)
    assert (changed.streams, changed.latest) == ({}, 0)
    changed.close()


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"null", b'{"schema": "aerodft.signing/1"}', b'{"schema": [], "key": 1}', b"\xff"]
)
def test_a_damaged_state_is_refused_and_not_forgotten(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    for _ in range(2):
        with pytest.raises(InputError, match="delete it to start anew"):
            SigningState.open(path, KEY)
    assert path.read_bytes() == content


def test_a_state_that_cannot_be_read_is_refused_and_not_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "state"
    state = SigningState.open(path, KEY)
    state.note((1, 1, 0), 99)
    state.close()

    def failing(_path: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "read_bytes", failing)
        with pytest.raises(InputError, match="cannot keep signing time stamps"):
            SigningState.open(path, KEY)
    again = SigningState.open(path, KEY)
    assert again.streams == {(1, 1, 0): 99}
    again.close()


def test_one_process_at_a_time(tmp_path: Path) -> None:
    held = SigningState.open(tmp_path / "state", KEY)
    with pytest.raises(InputError, match="another aerodft"):
        SigningState.open(tmp_path / "state", KEY)
    held.close()
    SigningState.open(tmp_path / "state", KEY).close()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="state_file"):
        SigningState.open(tmp_path / "none" / "state", KEY)


@pytest.mark.parametrize(("text", "is_said"), [("bad", True), ("a much longer passphrase", False), ("0" * 64, False)])
def test_a_passphrase_that_is_soon_guessed_is_said(tmp_path: Path, caplog, text: str, is_said: bool) -> None:  # noqa: FBT001
    path = tmp_path / "vehicle.key"
    path.write_text(text)
    path.chmod(0o600)
    load_key(path)
    assert ("a passphrase of 3 characters is soon guessed" in caplog.text) is is_said


def test_a_disk_that_fails_later_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    state = SigningState.open(folder / "state", KEY)
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()
    with caplog.at_level(logging.WARNING):
        for stamp in range(3):
            state.note((1, 1, 0), stamp)
            time.sleep(0.06)
            state.commit()
        state.close()
    assert caplog.text.count("would let old frames pass") == 1
