"""The page's server: where it listens, in a task or in a thread of its own."""

import asyncio
import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any, Final

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.netutil import bind_sockets
from tornado.web import Application

from aerodft.app.viewing import View
from aerodft.errors import LinkError
from aerodft.web.access import Access
from aerodft.web.handlers import ROUTES, Page

_MOST_REQUEST_BYTES: Final = 65_536
_MOST_CONNECTIONS: Final = 64  # a page keeps 7; the descriptors that are left are the recorder's
_IDLE_S: Final = 10.0  # of a connection that asks for nothing; a page's WebSocket is none
_PATIENCE_S: Final = 2.0
_CLOSING_S: Final = 6.0  # connections and the page's threads take 2 s each at most; the thread is a daemon


class _BoundedServer(HTTPServer):
    """A server that closes what comes while 64 connections are open."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - Tornado's own constructor
        """Tornado's own constructor."""
        super().initialize(*args, **kwargs)
        self._open: list[IOStream] = []

    def handle_stream(self, stream: IOStream, address: tuple[str, int]) -> None:
        """Take a new connection, or close it."""
        self._open = [each for each in self._open if not each.closed()]
        if len(self._open) >= _MOST_CONNECTIONS:
            stream.close()
            return
        self._open.append(stream)
        super().handle_stream(stream, address)


async def serve_view(view: View, access: Access, opened: Callable[[str], None]) -> None:
    """Serve the page until it is cancelled.

    Args:
        view: What it shows.
        access: Where, and who may open it.
        opened: Called with the address when it can be opened.

    Raises:
        LinkError: The port cannot be opened.
    """
    page = Page(view, access)
    application = Application(
        [(path, handler, {"page": page, **given}) for path, handler, given in ROUTES],
        websocket_max_message_size=_MOST_REQUEST_BYTES,
        log_function=lambda _: None,
        page_headers=access.headers,
    )
    server = _BoundedServer(
        application,
        max_body_size=_MOST_REQUEST_BYTES,
        max_buffer_size=2 * _MOST_REQUEST_BYTES,
        idle_connection_timeout=_IDLE_S,
    )
    try:
        sockets = bind_sockets(access.port, access.host)
    except OSError as error:
        where = f"{access.host}:{access.port}"
        raise LinkError(
            "the page's port cannot be opened", where=where, got=error, hint="`port` 0 takes a free one"
        ) from error
    server.add_sockets(sockets)
    try:
        opened(access.address(sockets[0].getsockname()[1]))
        await asyncio.sleep(math.inf)
    finally:
        server.stop()
        with suppress(TimeoutError):  # a browser that does not answer is not waited for
            await asyncio.wait_for(server.close_all_connections(), _PATIENCE_S)
        page.close()


@contextmanager
def page_beside(view: View, access: Access) -> Iterator[str]:
    """Serve the page in a thread of its own while the ``with`` block lasts; gives the address.

    Raises:
        LinkError: The port cannot be opened.
    """
    opened, loop = Future[str](), asyncio.new_event_loop()
    serving = loop.create_task(serve_view(view, access, opened.set_result))

    def run() -> None:
        try:
            with suppress(asyncio.CancelledError):
                loop.run_until_complete(serving)
        except LinkError as error:
            opened.set_exception(error)
        finally:
            loop.close()

    thread = threading.Thread(target=run, name="page", daemon=True)
    thread.start()
    try:
        yield opened.result()
    finally:
        with suppress(RuntimeError):  # it has ended by itself
            loop.call_soon_threadsafe(serving.cancel)
        thread.join(_CLOSING_S)
