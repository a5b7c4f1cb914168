"""Who shouts on the telemetry port does not drown who speaks there."""

import socket
import time
from contextlib import ExitStack

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkLink
from aerodft.service import Inbox
from aerodft.service.clocks import WallClock

SHOUTERS = 150  # more than a link keeps framers for
BURST = 500
ROUNDS = 60
WAIT_S = 10.0


def _attitude(mav: dialect.MAVLink, boot_ms: int) -> bytes:
    return bytes(dialect.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0).pack(mav))


def test_every_frame_among_garbage_of_many_senders_arrives() -> None:
    rng, clock = np.random.default_rng(12), WallClock()
    inbox, mav = Inbox(clock), dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    said, sent_bytes = [], 0
    with ExitStack() as stack:
        link = stack.enter_context(MavlinkLink("udpin:0", inbox))
        speaker, *shouters = (
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(SHOUTERS + 1)
        )
        for k in range(ROUNDS):
            frame = _attitude(mav, k)
            # Whoever was understood once is not forgotten for strangers.
            halves = (frame[:20], frame[20:]) if k else (b"", frame)  # a serial bridge cuts frames wherever it likes
            for part in halves:
                for _ in range(BURST // 2):
                    noise = rng.bytes(int(rng.integers(1, 100)))
                    shouters[int(rng.integers(SHOUTERS))].sendto(noise, ("127.0.0.1", link.local_port))
                    sent_bytes += len(noise)
                speaker.sendto(part, ("127.0.0.1", link.local_port))
            said.append(frame)
            until_s = time.monotonic() + WAIT_S
            while link.counts.frames < len(said) and time.monotonic() < until_s:
                time.sleep(0.001)
        counts = link.counts
    blocks = inbox.take(clock.now_ns() + 10**9).raw
    heard = [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]
    assert heard == said
    assert 0.9 * sent_bytes < counts.skipped_bytes <= sent_bytes
