"""The page's server: its files, the images and what is measured in them, over HTTP and a WebSocket."""

import asyncio
import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, TypeVar

import orjson
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketHandler

from aerodft.app.viewing import LiveView, RecordingView, View, evidence_of, hints_of, landmarks_in, probe_of
from aerodft.errors import AerodftError, LinkError, UsageError
from aerodft.web.access import HEADERS, Access

T = TypeVar("T")

_STATIC: Final = Path(__file__).parent / "static"
_COOKIE: Final = "aerodft_token"
_MOST_REQUEST_BYTES: Final = 65_536
_MOST_PROBES: Final = 64
_WITHOUT_PROBES: Final = frozenset({"river", "evidence", "import", "save", "overlay"})
_PATIENCE_S: Final = 2.0
_NEWS_S: Final = 1.0
"""A page waits so long for a new image, at the most, before it is told that there is none."""


class _Page:
    """What all requests share: the view, who may see it, a thread that measures, and one for what takes longer."""

    def __init__(self, view: View, access: Access, std_px: float) -> None:
        self.view = view
        self.access = access
        self.std_px = std_px
        self._works = {
            "evidence": self._calibrated,
            "import": self._imported,
            "save": self._saved,
            "overlay": self._overlay,
        }
        self._quick = ThreadPoolExecutor(1, "page-measures")
        self._slow = ThreadPoolExecutor(1, "page-pictures")

    async def quickly(self, work: Callable[[], T]) -> T:
        """The result of work of milliseconds."""
        return await asyncio.get_running_loop().run_in_executor(self._quick, work)

    async def slowly(self, work: Callable[[], T]) -> T:
        """The result of work on an image's pixels."""
        return await asyncio.get_running_loop().run_in_executor(self._slow, work)

    async def send(self, handler: RequestHandler, work: Callable[[], dict[str, Any]]) -> None:
        """Answer a request with a document.

        Raises:
            HTTPError: 404: there is none.
        """
        try:
            found = await self.slowly(work)
        except AerodftError as error:
            raise _missing(error) from error
        handler.set_header("Content-Type", "application/json")
        handler.write(orjson.dumps(found))

    def close(self) -> None:
        """Finish what is under way; what waits is given up."""
        self._quick.shutdown(cancel_futures=True)
        self._slow.shutdown(cancel_futures=True)

    async def answer(self, request: bytes) -> dict[str, Any]:
        """Answer one request of the page: ``id``, ``image`` and what is wanted of it.

        That is ``probes`` to measure, the ``overlay``, ``river`` with strokes, ``evidence`` to calibrate with,
        landmarks to ``import``, or a probe to ``save``.
        """
        number: object = None
        try:
            asked = _asked(request)
            number = asked.get("id")
            if "river" in asked:
                return {"id": number} | await self.slowly(lambda: {"river": self._river(asked)})
            work = next((each for key, each in self._works.items() if key in asked), self._measured)
            return {"id": number} | await self.quickly(lambda: work(asked))
        except AerodftError as error:
            return {"id": number, "error": str(error)}

    def _measured(self, asked: dict[str, Any]) -> dict[str, Any]:
        probes = [probe_of(each, self.std_px) for each in asked["probes"]]
        answer: dict[str, Any] = {
            "measurements": self.view.measure(asked["image"], probes, with_budget=bool(asked.get("budget")))
        }
        if asked.get("vertical") and probes:
            answer["vertical"] = self.view.vertical_px(asked["image"], probes[0])
        if asked.get("sampling") and probes:
            answer["sampling_m"] = self.view.sampling_m(asked["image"], probes[-1])
        return answer

    def _overlay(self, asked: dict[str, Any]) -> dict[str, Any]:
        return {"overlay": self.view.overlay(asked["image"])}

    def _saved(self, asked: dict[str, Any]) -> dict[str, Any]:
        if self.access.is_read_only:
            raise UsageError("this page only shows", expected="one that was not opened read-only, to save a probe")
        probe, is_tracked = probe_of(asked["save"], self.std_px), bool(asked.get("tracked"))
        return {"file": str(self.view.save_probe(asked["image"], probe, is_tracked=is_tracked))}

    def _calibrated(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The camera's pose from what is known of the view; from now on measured with, where that is asked for."""
        use, unknowns = bool(asked.get("use")), asked.get("unknowns")
        if use and self.access.is_read_only:
            raise UsageError("this page only shows", expected="one that was not opened read-only, to use a calibration")
        if not isinstance(unknowns, list) or not all(isinstance(each, str) for each in unknowns):
            raise UsageError("the unknowns", got=repr(unknowns)[:80], expected="a list of their names")
        return {"calibration": self.view.calibrate(evidence_of(asked["evidence"]), unknowns, use=use)}

    def _imported(self, asked: dict[str, Any]) -> dict[str, Any]:
        return landmarks_in(asked["import"])

    def _river(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The river in an image, with the strokes of that or another image as hints."""
        told = asked["river"] if isinstance(asked["river"], dict) else {}
        hinted = told.get("image", asked["image"])
        if type(hinted) is not int:
            raise UsageError("the image of the strokes", got=repr(hinted)[:40], expected="its number")
        return self.view.river(asked["image"], hints_of(told), hinted)


def _missing(error: AerodftError) -> HTTPError:
    return HTTPError(404, reason=str(error).encode("ascii", "replace").decode())


def _asked(request: bytes) -> dict[str, Any]:
    """A request's content.

    Raises:
        AerodftError: It is none.
    """
    try:
        asked = orjson.loads(request)
    except orjson.JSONDecodeError as error:
        raise UsageError("the request is no JSON", got=error) from None
    if not isinstance(asked, dict) or type(asked.get("image")) is not int:
        raise UsageError("the request names no image", expected='{"image": 0, "probes": [...]}')
    probes = asked.setdefault("probes", []) if _WITHOUT_PROBES & asked.keys() else asked.get("probes")
    if not isinstance(probes, list) or len(probes) > _MOST_PROBES:
        raise UsageError("the request's probes", expected=f"a list of at most {_MOST_PROBES}")
    return asked


class _Guarded(RequestHandler):
    """Refuses what does not come from the page itself, and from somebody with the token."""

    def initialize(self, page: _Page) -> None:
        """Tornado's own constructor of handlers."""
        self.page = page

    def set_default_headers(self) -> None:
        """Of every answer, errors too."""
        self.clear_header("Server")
        for name, value in HEADERS.items():
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

    def write_error(self, status_code: int, **kwargs: Any) -> None:  # noqa: ANN401, ARG002 - Tornado's own
        """One sentence, and nothing of the program."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class _File(_Guarded, StaticFileHandler):
    """A file of the page."""

    def initialize(self, page: _Page) -> None:  # type: ignore[override]  # its folder is always the same
        """See ``_Guarded``."""
        _Guarded.initialize(self, page)
        StaticFileHandler.initialize(self, str(_STATIC), "index.html")

    def set_extra_headers(self, path: str) -> None:  # noqa: ARG002 - Tornado's own
        """Nothing is kept by the browser: the next version's files bear the same names."""
        self.set_header("Cache-Control", "no-store")


class _Description(_Guarded):
    """What the view holds."""

    def get(self) -> None:
        """JSON: ``title``, what it is and can do, the camera's size, ``stamp_ns`` and ``seconds`` of every image."""
        view = self.page.view
        camera = view.camera
        images = [asdict(each) | {"stamp_ns": str(each.stamp_ns)} for each in view.images]
        self.set_header("Content-Type", "application/json")
        self.write(
            orjson.dumps(
                {
                    "title": view.title,
                    "is_live": isinstance(view, LiveView),
                    "is_recording": isinstance(view, RecordingView),
                    "can_save": view.station_file is not None and not self.page.access.is_read_only,
                    "width_px": camera.width_px,
                    "height_px": camera.height_px,
                    "images": images,
                }
            )
        )


class _Picture(_Guarded):
    """One image."""

    async def get(self, number: str) -> None:
        """JPEG.

        Raises:
            HTTPError: 404: there is none, or it is damaged.
        """
        try:
            data = await self.page.slowly(lambda: self.page.view.jpeg(int(number)))
        except AerodftError as error:
            raise _missing(error) from error
        self.set_header("Content-Type", "image/jpeg")
        self.write(data)


class _Seen(_Guarded):
    """What is known of an image without asking for anything."""

    async def get(self, number: str) -> None:
        """JSON as ``View.seen``.

        Raises:
            HTTPError: 404: there is none.
        """
        await self.page.send(self, lambda: self.page.view.seen(int(number)))


class _Series(_Guarded):
    """What was measured over time."""

    async def get(self) -> None:
        """JSON as ``RecordingView.series``.

        Raises:
            HTTPError: 404: what is shown is no recording, or it is damaged.
        """
        view = self.page.view
        if not isinstance(view, RecordingView):
            raise HTTPError(404, reason="this is no recording")
        await self.page.send(self, view.series)


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
        self.set_header("Content-Type", "application/json")
        self.write(orjson.dumps(news))


class _Measuring(_Guarded, WebSocketHandler):
    """Measures as the pointer moves: one request at a time, so that none pile up."""

    def check_origin(self, origin: str) -> bool:
        """See ``Access``; a browser always says where a WebSocket comes from."""
        return self.page.access.allows_origin(origin, self.request.headers.get("Host", ""))

    async def on_message(self, message: str | bytes) -> None:
        """Answer; the next message is read when this one is answered."""
        data = message.encode() if isinstance(message, str) else message
        await self.write_message(orjson.dumps(await self.page.answer(data)).decode())


async def serve_view(view: View, access: Access, std_px: float, opened: Callable[[str], None]) -> None:
    """Serve the page until it is cancelled.

    Args:
        view: What it shows.
        access: Where, and who may open it.
        std_px: Of each pixel coordinate that people click.
        opened: Called with the address when it can be opened.

    Raises:
        LinkError: The port cannot be opened.
    """
    page = _Page(view, access, std_px)
    routes: list[Any] = [
        (r"/view\.json", _Description, {"page": page}),
        (r"/images/(\d{1,9})\.jpg", _Picture, {"page": page}),
        (r"/images/(\d{1,9})\.json", _Seen, {"page": page}),
        (r"/series\.json", _Series, {"page": page}),
        (r"/news\.json", _News, {"page": page}),
        (r"/measure", _Measuring, {"page": page}),
        (r"/(.*)", _File, {"page": page}),
    ]
    application = Application(routes, websocket_max_message_size=_MOST_REQUEST_BYTES, log_function=lambda _: None)
    server = HTTPServer(application, max_body_size=_MOST_REQUEST_BYTES, max_buffer_size=2 * _MOST_REQUEST_BYTES)
    try:
        sockets = bind_sockets(access.port, access.host)
    except OSError as error:
        where = f"{access.host}:{access.port}"
        raise LinkError(
            "the page's port cannot be opened", where=where, got=error.strerror, hint="`port` 0 takes a free one"
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
def page_beside(view: View, access: Access, std_px: float) -> Iterator[str]:
    """Serve the page in a thread of its own while the ``with`` block lasts; gives the address.

    Raises:
        LinkError: The port cannot be opened.
    """
    opened, loop = Future[str](), asyncio.new_event_loop()
    serving = loop.create_task(serve_view(view, access, std_px, opened.set_result))

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
        thread.join()
