"""A live link at full rate, against pymavlink, and under a flood: ``python tests/bench/bench_live.py``."""

import argparse
import socket
import subprocess
import sys
import time
from pathlib import Path

from pymavlink import mavutil

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder, MavlinkLink
from aerodft.model import VehicleTrack
from aerodft.service import Inbox
from aerodft.service.clocks import WallClock

HOST = "127.0.0.1"
SENDER = Path(__file__).with_name("peer_sender.py")
TICK_S = 0.05
SETTLE_S = 0.5


class _Senders:
    """Processes that send at the same time: kind, rate (Hz) and number of datagrams each."""

    def __init__(self, port: int, *loads: tuple[str, int, int]) -> None:
        self._processes = [
            subprocess.Popen([sys.executable, str(SENDER), kind, str(port), str(rate_hz), str(count)])
            for kind, rate_hz, count in loads
        ]

    @property
    def are_done(self) -> bool:
        return all(process.poll() is not None for process in self._processes)


def _ours(rate_hz: int, count: int, flood_hz: int = 0) -> tuple[int, float]:
    """Messages that were decoded, and processor seconds: reading, framing, stamping, decoding."""
    clock, decoder, got = WallClock(), MavlinkDecoder(), 0
    inbox = Inbox(clock)
    with MavlinkLink("udpin:0", inbox) as link:
        loads = [("attitude", rate_hz, count)]
        if flood_hz:
            loads.append(("garbage", flood_hz, flood_hz * count // rate_hz))
        senders = _Senders(link.local_port, *loads)
        start_s, last_s = time.process_time(), time.monotonic()
        while time.monotonic() < last_s + SETTLE_S:
            time.sleep(TICK_S)
            tracks = [track for block in inbox.take(clock.now_ns()).raw for track in decoder.decode(block)]
            got += sum(len(track.arrival_ns) for track in tracks if isinstance(track, VehicleTrack))
            if tracks or not senders.are_done:
                last_s = time.monotonic()
        return got, time.process_time() - start_s


def _theirs(rate_hz: int, count: int) -> tuple[int, float]:
    """The same with pymavlink."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOST, 0))
        port = free.getsockname()[1]
    link = mavutil.mavlink_connection(f"udpin:{HOST}:{port}")
    link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    senders = _Senders(port, ("attitude", rate_hz, count))
    got, start_s, last_s = 0, time.process_time(), time.monotonic()
    while time.monotonic() < last_s + SETTLE_S:
        message = link.recv_match(type="ATTITUDE", blocking=True, timeout=TICK_S)
        got += message is not None
        if message is not None or not senders.are_done:
            last_s = time.monotonic()
    cpu_s = time.process_time() - start_s
    link.close()
    return got, cpu_s


def main(arguments: list[str] | None = None) -> None:
    """Print what was lost and what it cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=int, default=20_000, help="messages a second")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--flood", type=int, default=60_000, help="garbage datagrams a second")
    args = parser.parse_args(arguments)
    count = int(args.rate * args.seconds)
    got, ours_s = _ours(args.rate, count)
    print(f"{args.rate} messages/s: {count - got} of {count} lost, {ours_s / got * 1e6:.1f} us of processor a message")
    got, theirs_s = _theirs(args.rate, count)
    share = (ours_s / count) / (theirs_s / got)
    print(
        f"pymavlink: {count - got} of {count} lost, {theirs_s / got * 1e6:.1f} us a message; ours is {share:.2f} of it"
    )
    calm_hz = max(args.rate // 100, 1)
    calm = int(calm_hz * args.seconds)
    got, _ = _ours(calm_hz, calm, args.flood)
    print(f"among {args.flood} garbage datagrams/s: {calm - got} of {calm} messages lost")


if __name__ == "__main__":
    main()
