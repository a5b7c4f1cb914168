"""What a page fetches: its files, the images and what is known of them; and the WebSocket that it asks over."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final, TypeVar

import orjson
from tornado.web import HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketHandler

from aerodft.app.measure import Position
from aerodft.app.viewing import LiveView, RecordingView, View, kinds_document
from aerodft.errors import AerodftError
from aerodft.web.access import Access
from aerodft.web.answers import Answers

T = TypeVar("T")

_STATIC: Final = Path(__file__).parent / "static"
_COOKIE: Final = "aerodft_token"
_CLOSING_S: Final = 2.0  # a measurement takes milliseconds, the reading of a long recording may take minutes
_NEWS_S: Final = 1.0
"""A page waits so long for a new image, at the most, before it is told that there is none."""


class Page:
    """What all requests share: the view, who may see it, and threads: for measuring, for pictures, for long reading.

    Args:
        view: What is shown.
        access: Who may see it.
    """

    def __init__(self, view: View, access: Access) -> None:
        self.view = view
        self.access = access
        self._answers = Answers(view, is_read_only=access.is_read_only)
        self._quick = ThreadPoolExecutor(1, "page-measures")
        self._slow = ThreadPoolExecutor(1, "page-pictures")
        self._long = ThreadPoolExecutor(1, "page-reads")
        self._quick.submit(self._warm_up)
        if view.finder is not None:
            self._long.submit(import_module, "aerodft.app.calibrate")  # a second, while people look for landmarks

    async def found(self, work: Callable[[], T], *, is_long: bool = False) -> T:
        """The result of work on an image, or where it is long on a whole recording.

        Raises:
            HTTPError: 404: there is none, or it is damaged.
        """
        try:
            return await asyncio.get_running_loop().run_in_executor(self._long if is_long else self._slow, work)
        except AerodftError as error:
            raise HTTPError(404, reason=str(error).encode("ascii", "replace").decode()) from error

    async def answer(self, request: bytes) -> dict[str, Any]:
        """The answer to a message of the page, see ``Answers``: with the ``id`` of that, or with an ``error``."""
        number: object = None
        try:
            asked = self._answers.question(request)
            number = asked.get("id")
            pool = self._quick if self._answers.is_quick(asked) else self._slow
            answer = await asyncio.get_running_loop().run_in_executor(pool, self._answers.answer, asked)
        except AerodftError as error:
            answer = {"error": str(error)}
        return {"id": number, **answer}

    def _warm_up(self) -> None:
        """Measure once, as the first measurement takes a third of a second longer than the next ones."""
        camera = self.view.camera
        centre = Position([((camera.width_px - 1) / 2, (camera.height_px - 1) / 2)])
        with suppress(AerodftError):
            self.view.measure(0, [centre], with_budget=True)

    def close(self) -> None:
        """Finish what is under way within 2 s; what waits is given up."""

        def shut_down() -> None:
            for pool in pools:
                pool.shutdown()

        pools = (self._quick, self._slow, self._long)
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        closing = threading.Thread(target=shut_down, name="page-closing", daemon=True)
        closing.start()
        closing.join(_CLOSING_S)


class _Guarded(RequestHandler):
    """Refuses what does not come from the page itself, and from somebody with the token."""

    def initialize(self, page: Page) -> None:
        """Tornado's own constructor of handlers."""
        self.page = page

    def set_default_headers(self) -> None:
        """Of every answer, errors too."""
        self.clear_header("Server")
        for name, value in self.application.settings["page_headers"].items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse, or let go on.

        Raises:
            HTTPError: 403.
        """
        access, headers = self.page.access, self.request.headers
        host = headers.get("Host", "")
        if not access.allows_host(host):
            raise HTTPError(403, reason="this page is not at that host")
        if not access.allows_origin(headers.get("Origin"), host):
            raise HTTPError(403, reason="the request comes from another site")
        given = self.get_query_argument("token", None)
        if not access.allows_token(given or self.get_cookie(_COOKIE)):
            raise HTTPError(403, reason="the token is missing or wrong: open the address that was printed")
        if given is not None:
            self.set_cookie(_COOKIE, given, httponly=True, samesite="Strict")

    def send(self, document: object) -> None:
        """Answer with a JSON document."""
        self.set_header("Content-Type", "application/json")
        self.write(orjson.dumps(document))

    def write_error(self, status_code: int, **kwargs: Any) -> None:  # noqa: ANN401, ARG002 - Tornado's own
        """One sentence, and nothing of the program."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class _File(_Guarded, StaticFileHandler):
    """A file of the page."""

    def initialize(self, page: Page) -> None:  # type: ignore[override]  # its folder is always the same
        """See ``_Guarded``."""
        _Guarded.initialize(self, page)
        StaticFileHandler.initialize(self, str(_STATIC), "index.html")

    def validate_absolute_path(self, root: str, absolute_path: str) -> str | None:
        """The path of a file that is there.

        Raises:
            HTTPError: 404: no file can have such a name.
        """
        try:
            return super().validate_absolute_path(root, absolute_path)
        except (OSError, ValueError):  # too long, or with a null in it
            raise HTTPError(404) from None

    def set_extra_headers(self, path: str) -> None:  # noqa: ARG002 - Tornado's own
        """Nothing is kept by the browser: the next version's files bear the same names."""
        self.set_header("Cache-Control", "no-store")


class _Picture(_Guarded):
    """One image."""

    async def get(self, number: str) -> None:
        """JPEG; 404 where there is none, or it is damaged."""
        data = await self.page.found(lambda: self.page.view.jpeg(int(number)))
        self.set_header("Content-Type", "image/jpeg")
        self.write(data)


class _Json(_Guarded):
    """A document."""

    def initialize(  # type: ignore[override]  # a route gives it more
        self, page: Page, find: Callable[..., object], *, is_long: bool = False
    ) -> None:
        """What finds the document in a page, with the parts of the path; whether that reads a whole recording."""
        super().initialize(page)
        self._find, self._is_long = find, is_long

    async def get(self, *parts: str) -> None:
        """JSON; 404 where there is no such thing, or it is damaged."""
        self.send(await self.page.found(partial(self._find, self.page, *parts), is_long=self._is_long))


def _description(page: Page) -> dict[str, Any]:
    """``title``, what the view is and can do, the camera's size, ``stamp_ns`` and ``seconds`` of every image."""
    view, access = page.view, page.access
    return {
        "title": view.title,
        "is_live": isinstance(view, LiveView),
        "is_recording": isinstance(view, RecordingView),
        "can_calibrate": view.finder is not None,
        "is_read_only": access.is_read_only,
        "can_save": view.station_file is not None and not access.is_read_only,
        "tiles": access.tiles,
        "kinds": kinds_document(),
        "width_px": view.camera.width_px,
        "height_px": view.camera.height_px,
        "images": [asdict(each) | {"stamp_ns": str(each.stamp_ns)} for each in view.images],
    }


def _series(page: Page) -> object:
    """What was measured over time, see ``RecordingView.series``."""
    if not isinstance(page.view, RecordingView):
        raise HTTPError(404, reason="this is no recording")
    return page.view.series()


class _News(_Guarded):
    """What a station that measures has that a page has not shown yet."""

    async def get(self) -> None:
        """JSON as ``LiveView.news``: as soon as there is an image after that of ``after``, or after a second.

        Raises:
            HTTPError: 404: what is shown is not live.
        """
        view = self.page.view
        if not isinstance(view, LiveView):
            raise HTTPError(404, reason="this is no live station")
        after, came, loop = self.get_query_argument("after", ""), asyncio.Event(), asyncio.get_running_loop()
        with view.heard_by(lambda: loop.call_soon_threadsafe(came.set)):
            news = view.news()  # asked first: a station prepares images only while somebody asks
            if str(view.newest) == after:
                with suppress(TimeoutError):
                    await asyncio.wait_for(came.wait(), _NEWS_S)
                news = view.news()
        self.send(news)


class _Measuring(_Guarded, WebSocketHandler):
    """Measures as the pointer moves: one request at a time, so that none pile up."""

    def check_origin(self, origin: str) -> bool:
        """See ``Access``; a browser always says where a WebSocket comes from."""
        return self.page.access.allows_origin(origin, self.request.headers.get("Host", ""))

    async def on_message(self, message: str | bytes) -> None:
        """Answer; the next message is read when this one is answered."""
        data = message.encode() if isinstance(message, str) else message
        await self.write_message(orjson.dumps(await self.page.answer(data)).decode())


ROUTES: Final[tuple[tuple[str, type[_Guarded], dict[str, Any]], ...]] = (
    (r"/view\.json", _Json, {"find": _description}),
    (r"/images/(\d{1,9})\.jpg", _Picture, {}),
    (r"/images/(\d{1,9})\.json", _Json, {"find": lambda page, number: page.view.seen(int(number))}),
    (r"/series\.json", _Json, {"find": _series, "is_long": True}),
    (r"/doctor\.json", _Json, {"find": lambda page: page.view.doctor(), "is_long": True}),
    (r"/news\.json", _News, {}),
    (r"/measure", _Measuring, {}),
    (r"/(.*)", _File, {}),
)
"""Paths, what answers there, and what that is given beside the ``page``."""
