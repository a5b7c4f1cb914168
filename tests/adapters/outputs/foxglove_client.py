"""A viewer of Foxglove's protocol over a real websocket, as far as tests need one."""

import asyncio
import base64
import os
import re
import socket
import struct
import threading
import time
from contextlib import contextmanager, suppress

import orjson
from tornado.websocket import websocket_connect

PATIENCE_S = 30.0
_MESSAGE, _HEAD = 1, struct.Struct("<BIQ")  # opcode, subscription, log time


class Viewer:
    """Subscribes to every topic that the server offers, and keeps what comes, until it is left.

    Attributes:
        channels: What the server says of each topic.
        messages: ``(topic, log_ns, data)`` in order.
    """

    def __init__(self, port):
        self._port = port
        self.channels, self.messages = {}, []
        self._ready, self._stop = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._look()))

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *_):
        with suppress(RuntimeError):  # the server has ended, and so did the loop
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE_S)

    def of(self, topic):
        return [data for name, _, data in self.messages if name == topic]

    def wait_for(self, condition):
        until = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < until, [topic for topic, _, _ in self.messages][-10:]
            time.sleep(0.001)

    async def _look(self):
        self._loop = asyncio.get_running_loop()
        link = await websocket_connect(f"ws://127.0.0.1:{self._port}", subprotocols=["foxglove.sdk.v1"])
        ending = asyncio.ensure_future(self._stop.wait())
        topics: dict[int, str] = {}
        while not ending.done():
            reading = asyncio.ensure_future(link.read_message())
            await asyncio.wait({reading, ending}, return_when=asyncio.FIRST_COMPLETED)
            if not reading.done() or (message := reading.result()) is None:
                break
            if isinstance(message, str):
                document = orjson.loads(message)
                for channel in document.get("channels", ()):
                    number = len(topics)
                    topics[number] = channel["topic"]
                    self.channels[channel["topic"]] = channel
                    await link.write_message(
                        orjson.dumps({"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel["id"]}]})
                    )
                if document["op"] == "advertise":
                    self._ready.set()
            elif message[0] == _MESSAGE:
                _, number, log_ns = _HEAD.unpack_from(message)
                self.messages.append((topics[number], log_ns, message[_HEAD.size :]))
        link.close()


@contextmanager
def deaf_viewer(port):
    """A viewer that asks for images and never reads."""
    with socket.create_connection(("127.0.0.1", port)) as link:
        key = base64.b64encode(os.urandom(16)).decode()
        link.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        said = b""
        while not (b'"advertise"' in said and said.endswith(b"}]}")):
            said += link.recv(65536)
        for number in map(int, re.findall(rb'"id":(\d+)', said)):
            text = orjson.dumps({"op": "subscribe", "subscriptions": [{"id": number, "channelId": number}]})
            link.sendall(bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text)  # masked with zeros
        yield
        assert len(link.recv(1 << 20)) > 100_000  # it would have been sent a lot
