import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from aerodft.adapters.images import StreamReader
from aerodft.adapters.images.stream import UdpFile
from aerodft.errors import ConfigError, LinkError
from aerodft.model import Image, StampClock
from aerodft.service.clocks import WallClock

RATE_HZ = 30
CLOCK = WallClock()
TOLERANCE_NS = 20_000  # a tick of the transport stream's clock takes 11 us


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class Receiver:
    """Collects images, and lets a test wait for a number of them."""

    def __init__(self) -> None:
        self.images: list[Image] = []
        self.changed = threading.Condition()
        self.gate = threading.Event()
        self.gate.set()

    def __call__(self, image: Image) -> None:
        self.gate.wait(10)
        with self.changed:
            self.images.append(image)
            self.changed.notify_all()

    def wait_for(self, count: int) -> bool:
        with self.changed:
            return self.changed.wait_for(lambda: len(self.images) >= count, timeout=10)


class SendersClock:
    """Stands still at the time for which an image was made until the next one is sent, however late a host is with it.

    The stamps' truth: what is received late comes with a later image's time, a period off at least.
    """

    def __init__(self) -> None:
        self.at_ns = CLOCK.now_ns()

    def now_ns(self) -> int:
        return self.at_ns


class Sender:
    """Sends H.264 in MPEG-TS over UDP at a steady rate; image ``i`` has brightness 20 + 12 (i mod 16)."""

    def __init__(self, port: int, muxer: str = "mpegts", clock: SendersClock | None = None, key_every: int = 8) -> None:
        self._key_every = key_every
        self.due_ns: list[int] = []
        self._clock = clock or SendersClock()
        self._muxer = muxer
        self._port = port
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)

    @contextmanager
    def running(self) -> Iterator["Sender"]:
        self._thread.start()
        try:
            yield self
        finally:
            self._stopping.set()
            self._thread.join()

    def _run(self) -> None:
        url = f"udp://127.0.0.1:{self._port}?pkt_size=1316"
        with av.open(url, "w", format=self._muxer, options={"flush_packets": "1"}) as container:
            stream = container.add_stream("libx264", rate=RATE_HZ)
            stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
            stream.options = {"preset": "ultrafast", "tune": "zerolatency", "g": str(self._key_every)}
            begin, begin_ns = time.monotonic(), CLOCK.now_ns()
            for index in range(10_000):
                if self._stopping.wait(max(0.0, begin + index / RATE_HZ - time.monotonic())):
                    break
                pixels = np.full((120, 160, 3), 20 + 12 * (index % 16), dtype=np.uint8)
                frame = av.VideoFrame.from_ndarray(pixels, format="bgr24")
                frame.pts, frame.time_base = index, Fraction(1, RATE_HZ)
                self.due_ns.append(begin_ns + index * 1_000_000_000 // RATE_HZ)
                self._clock.at_ns = self.due_ns[-1]
                container.mux(stream.encode(frame))


def test_a_udp_stream_is_stamped_with_when_it_was_sent(port: int, caplog: pytest.LogCaptureFixture) -> None:
    receiver, clock = Receiver(), SendersClock()
    with caplog.at_level(logging.INFO):
        reader = StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=clock, time_offset_s=-10.0)
        with reader, Sender(port, clock=clock).running() as sender:
            assert receiver.wait_for(30)
            assert reader.status.connected
    errors_ms, greys = [], []
    due_ns = np.array(sender.due_ns)
    for image in receiver.images:
        stamp_ns = image.stamp_ns + 10_000_000_000
        index = int(np.argmin(np.abs(due_ns - stamp_ns)))
        errors_ms.append((stamp_ns - due_ns[index]) / 1e6)
        assert image.pixels is not None
        greys.append(float(image.pixels().mean()) - (20 + 12 * (index % 16)))
        assert image.clock is StampClock.HOST
        assert image.arrival_ns > stamp_ns - TOLERANCE_NS
    assert np.abs(errors_ms).max() < TOLERANCE_NS / 1e6
    assert np.abs(greys).max() < 6.0
    assert [image.index for image in receiver.images] == list(range(len(receiver.images)))
    assert "first key image" in caplog.text
    assert "images are coming, 160 x 120 px" in caplog.text
    assert reader.status.images == len(receiver.images)


@pytest.mark.parametrize("key_every_s", [1, 25])
def test_no_image_is_lost_unsaid_from_the_first_key_image_on(port: int, key_every_s: int) -> None:
    receiver = Receiver()
    with StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK, silence_s=0.3) as reader:
        total = 0
        for connection in (1, 2):
            with Sender(port, key_every=key_every_s * RATE_HZ).running() as sender:
                assert receiver.wait_for(20 * connection)
            until(lambda connection=connection: reader.status.losses == connection)
            total += len(sender.due_ns)
            # The last image ends where the next one would begin.
            assert total - 2 * connection <= reader.status.images + sum(reader.status.left_out.values()) <= total
    assert reader.status.left_out.keys() <= {"unstamped", "too_many"}
    assert reader.status.left_out["unstamped"] <= 2 * 2 * RATE_HZ


def test_a_stream_that_comes_back_is_found_again(port: int, caplog: pytest.LogCaptureFixture) -> None:
    receiver = Receiver()
    with StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK, silence_s=0.3) as reader:
        with Sender(port).running():
            assert receiver.wait_for(3)
        until(lambda: reader.status.losses == 1)
        assert not reader.status.connected
        before = len(receiver.images)
        with Sender(port).running():
            assert receiver.wait_for(before + 3)
    stamps = [image.stamp_ns for image in receiver.images]
    assert stamps == sorted(set(stamps))
    assert "no images (it ended, or fell silent); trying again in 0.2 s" in caplog.text


def test_a_sender_that_starts_anew_in_between_is_stamped_anew(port: int) -> None:
    receiver, clock = Receiver(), SendersClock()
    with StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=clock):
        with Sender(port, clock=clock).running() as first:
            assert receiver.wait_for(30)  # a second and a half: the new sender's time goes back by more than a second
        with Sender(port, clock=clock).running() as second:  # whose first bytes let the last image of the other out
            until(lambda: bool(second.due_ns) and stamped_from(receiver, second.due_ns[0]) >= 5)
    due_ns = np.array([*first.due_ns, *second.due_ns])
    stamps_ns = np.array([image.stamp_ns for image in receiver.images])
    assert np.abs(due_ns[:, None] - stamps_ns).min(axis=0).max() < TOLERANCE_NS


def stamped_from(receiver: Receiver, stamp_ns: int) -> int:
    """How many images are not before a time."""
    return sum(image.stamp_ns > stamp_ns - TOLERANCE_NS for image in receiver.images)


def test_a_slow_receiver_gets_the_newest_images(port: int) -> None:
    receiver = Receiver()
    with StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK) as reader, Sender(port).running():
        assert receiver.wait_for(1)
        receiver.gate.clear()
        until(lambda: reader.status.left_out.get("too_many", 0) >= 6)
        released_ns = CLOCK.now_ns()
        receiver.gate.set()
        assert receiver.wait_for(8)
    gap = max(np.diff([image.index for image in receiver.images]))
    assert gap > 5
    assert receiver.images[-1].stamp_ns > released_ns - 10**9


def test_noise_on_the_port_is_dropped(port: int, caplog: pytest.LogCaptureFixture) -> None:
    receiver = Receiver()
    noise = np.random.default_rng(1)
    with (
        StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK) as reader,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.sendto(b"\x80\x60" + noise.bytes(700), ("127.0.0.1", port))
        with Sender(port).running():
            for count in range(1, 12):
                for _ in range(10):
                    stranger.sendto(b"\x01" + noise.bytes(700), ("127.0.0.1", port))
                assert receiver.wait_for(count)
        assert reader.status.losses == 0
        assert reader.status.left_out.keys() <= {"unstamped"}
    assert f"UDP port {port}: dropped a datagram that holds RTP, which needs a session description" in caplog.text
    assert caplog.text.count("dropped a datagram") == 1


def test_plain_h264_is_read_too(port: int) -> None:
    receiver = Receiver()
    with StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK), Sender(port, "h264").running():
        assert receiver.wait_for(5)
    assert receiver.images[-1].width_px == 160


def test_it_stops_at_once_although_nothing_comes(port: int) -> None:
    reader = StreamReader(f"udp://127.0.0.1:{port}", lambda image: pytest.fail(str(image)), clock=CLOCK)
    reader.start()
    begin = time.monotonic()
    reader.stop()
    assert time.monotonic() - begin < 1.0
    assert not reader.status.connected
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("image-")]


def test_a_server_that_refuses_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"rtsp://127.0.0.1:{probe.getsockname()[1]}/live"
    with StreamReader(url, lambda image: pytest.fail(str(image)), clock=CLOCK) as reader:
        until(lambda: reader.status.losses >= 2)
    assert f"{url}: no images (Connection refused); trying again in 0.4 s" in caplog.text


def test_a_busy_port_or_a_missing_device_is_told_at_once(port: int, tmp_path: Path) -> None:
    receiver = Receiver()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        with pytest.raises(LinkError, match="cannot listen for images: Address already in use; another program"):
            StreamReader(f"udp://127.0.0.1:{port}", receiver, clock=CLOCK).start()
    with pytest.raises(LinkError, match="video9: no such device; is the camera plugged in"):
        StreamReader(str(tmp_path / "video9"), receiver, clock=CLOCK).start()
    with pytest.raises(LinkError, match="cannot listen for images: Cannot assign requested address"):
        StreamReader("udp://192.0.2.1:5600", receiver, clock=CLOCK).start()


@pytest.mark.parametrize("url", ["udp://127.0.0.1", "udp://127.0.0.1:99999", "udp://127.0.0.1:x"])
def test_a_udp_address_needs_a_port(url: str) -> None:
    with pytest.raises(ConfigError, match="not a UDP address: expected udp://HOST:PORT"):
        StreamReader(url, Receiver(), clock=CLOCK).start()


def test_a_port_reads_like_a_file_and_knows_when_each_byte_came() -> None:
    stopping = threading.Event()
    file = UdpFile("udp://127.0.0.1:0", clock=CLOCK, stopping=stopping, silence_s=5)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        before_ns = CLOCK.now_ns()
        sender.sendto(b"hello", ("127.0.0.1", file.port))
        sender.sendto(b"\0\0\1def", ("127.0.0.1", file.port))
        assert file.await_format() == "h264"
        assert file.dropped == 1
        assert file.read(4) == b"\0\0\1d"
        assert file.read(4) == b"ef"
        sender.sendto(b"ghi", ("127.0.0.1", file.port))
        assert file.read(9) == b"ghi"
    first, second = file.arrival_ns(5), file.arrival_ns(6)
    assert first is not None
    assert second is not None
    assert before_ns < first < second < CLOCK.now_ns()
    assert file.arrival_ns(0) == first
    assert file.arrival_ns(-1) is None
    stopping.set()
    assert file.read(9) == b""
    assert file.await_format() is None
    file.close()
