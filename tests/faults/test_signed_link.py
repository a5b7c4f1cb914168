"""A signed link under attack: what is genuine gets through, all of it, and nothing else does."""

import socket
import time
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkLink
from aerodft.adapters.telemetry.mavlink.signing import open_signing, signing_time
from aerodft.service import Inbox, SigningSettings
from aerodft.service.clocks import WallClock

KEY = bytes(range(100, 132))
ROUNDS = 300
FAR_FUTURE = 10**9  # steps of 10 us: about three hours
WAIT_S = 10.0


def _peer(key: bytes | None, stamp: int) -> dialect.MAVLink:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    if key is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = key, True, stamp
    return mav


def _attitude(mav: dialect.MAVLink, boot_ms: int) -> bytes:
    return bytes(dialect.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0).pack(mav))


class Attack:
    """Genuine frames with forged ones between them, in an order drawn once."""

    def __init__(self, seed: int) -> None:
        now = signing_time(WallClock().now_ns())
        self.rng = np.random.default_rng(seed)
        self.vehicle = _peer(KEY, now)
        self.forgers = {
            "unsigned": _peer(None, 0),
            "wrong key": _peer(bytes(32), now),
            "far-future, wrong key": _peer(bytes(32), now + FAR_FUTURE),
            "far-future, right key": _peer(KEY, now + FAR_FUTURE),
        }
        self.recorded: list[bytes] = []

    def round(self, boot_ms: int) -> tuple[bytes, list[bytes]]:
        """A genuine frame, and forged ones that come before or after it."""
        genuine = _attitude(self.vehicle, boot_ms)
        forged = [_attitude(mav, 10**6 + boot_ms) for mav in self.forgers.values()]
        forged += [self.recorded[k] for k in self.rng.integers(0, len(self.recorded), 2)] if self.recorded else []
        self.recorded.append(genuine)
        return genuine, forged


@pytest.fixture
def settings(tmp_path: Path) -> SigningSettings:
    (tmp_path / "vehicle.key").write_text(KEY.hex())
    (tmp_path / "vehicle.key").chmod(0o600)
    return SigningSettings(key_file=tmp_path / "vehicle.key")


class Listener:
    """The product's own link with a socket that sends to it."""

    def __init__(self, settings: SigningSettings) -> None:
        self._clock = WallClock()
        self._inbox = Inbox(self._clock)
        self.check = open_signing(settings, self._clock.now_ns)
        self.link = MavlinkLink("udpin:0", self._inbox, signing=self.check)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sent = 0

    def send(self, frame: bytes) -> None:
        self.socket.sendto(frame, ("127.0.0.1", self.link.local_port))
        self.sent += 1
        if self.sent % 100 == 0:
            self.settle()

    def settle(self) -> None:
        until_s = time.monotonic() + WAIT_S
        while self.link.counts.frames < self.sent and time.monotonic() < until_s:
            time.sleep(0.01)

    def taken(self) -> list[bytes]:
        self.settle()
        self.link.close()
        blocks = self._inbox.take(self._clock.now_ns() + 10**9).raw
        self.socket.close()
        self.check.close()
        return [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]


def test_under_attack_and_across_restarts(settings: SigningSettings, capsys: pytest.CaptureFixture[str]) -> None:
    attack = Attack(7)
    totals = {"genuine": 0, "believed": 0, "forged": 0, "forged and believed": 0}
    for session in range(3):
        listener = Listener(settings)
        genuine: list[bytes] = []
        forged: list[bytes] = list(attack.recorded)  # the whole past, before the vehicle says anything new
        for frame in forged:
            listener.send(frame)
        for k in range(ROUNDS):
            good, bad = attack.round(session * ROUNDS + k)
            genuine.append(good)
            forged += bad
            cut = int(attack.rng.integers(0, len(bad) + 1))
            for frame in (*bad[:cut], good, *bad[cut:]):
                listener.send(frame)
        taken = listener.taken()
        assert taken == genuine
        totals["genuine"] += len(genuine)
        totals["believed"] += len(taken)
        totals["forged"] += len(forged)
        totals["forged and believed"] += len(set(forged) & set(taken) - set(genuine))
    counts = listener.check.counts
    assert sum(counts.refused.values()) == listener.sent - ROUNDS
    with capsys.disabled():
        print(f"\nsigned link, 3 sessions: {totals}; refused in the last: {counts.refused}")


def test_pymavlinks_own_connection_is_heard_and_hears(settings: SigningSettings) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    vehicle = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=1, source_component=1)
    clock = WallClock()
    inbox = Inbox(clock)
    check = open_signing(settings, clock.now_ns)
    with MavlinkLink(f"udpout:127.0.0.1:{port}", inbox, signing=check) as link:
        vehicle.recv_match(type="HEARTBEAT", blocking=True, timeout=WAIT_S)  # it speaks MAVLink 2 from now on
        vehicle.setup_signing(KEY, sign_outgoing=True)
        heard = vehicle.recv_match(type="HEARTBEAT", blocking=True, timeout=WAIT_S)
        for k in range(50):
            vehicle.mav.attitude_send(k, 0.1, 0.2, 0.3, 0, 0, 0)
        until_s = time.monotonic() + WAIT_S
        while check.counts.verified < 50 and time.monotonic() < until_s:
            time.sleep(0.01)
        assert link.signing is not None
        assert (link.signing.verified, link.signing.refused) == (50, {})
    vehicle.close()
    check.close()
    assert heard is not None
    assert heard.get_signed()
    assert vehicle.mav.signing.badsig_count == 0
