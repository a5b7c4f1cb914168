"""Sends datagrams to a port of this machine: ``python peer_sender.py attitude|garbage PORT RATE_HZ COUNT``."""

import socket
import sys
import time

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

KINDS = 1000
PAUSE_S = 0.0005


def attitudes() -> list[bytes]:
    """One frame of each sequence number."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for mav.seq in range(256):
        frames.append(bytes(dialect.MAVLink_attitude_message(mav.seq * 10, 0.1, 0.2, 0.3, 0.01, 0, 0).pack(mav)))
    return frames


def garbage() -> list[bytes]:
    """Random bytes of random length, fixed."""
    rng = np.random.default_rng(1)
    return [rng.bytes(int(size)) for size in rng.integers(1, 200, KINDS)]


def send(port: int, datagrams: list[bytes], rate_hz: int, count: int) -> None:
    """Send ``count`` datagrams at a rate, as long as somebody listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        start_s, sent = time.monotonic(), 0
        while sent < count:
            due = min(int((time.monotonic() - start_s) * rate_hz) + 1, count)
            for k in range(sent, due):
                sock.send(datagrams[k % len(datagrams)])
            sent = due
            time.sleep(PAUSE_S)


if __name__ == "__main__":
    send(int(sys.argv[2]), {"attitude": attitudes, "garbage": garbage}[sys.argv[1]](), *map(int, sys.argv[3:5]))
