"""The page's server: its files, the images and what is measured in them, over HTTP and a WebSocket."""

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import orjson
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketHandler

from aerodft.app.viewing import View, hints_of, landmark_of, probe_of
from aerodft.errors import AerodftError, LinkError, UsageError
from aerodft.web.access import HEADERS, Access

_STATIC: Final = Path(__file__).parent / "static"
_COOKIE: Final = "aerodft_token"
_MOST_REQUEST_BYTES: Final = 65_536
_MOST_PROBES: Final = 64
_MOST_LANDMARKS: Final = 256
_PATIENCE_S: Final = 2.0


class _Page:
    """What all requests share: the view, who may see it, and the one thread that measures."""

    def __init__(self, view: View, access: Access, std_px: float) -> None:
        self.view = view
        self.access = access
        self.std_px = std_px
        self.worker = ThreadPoolExecutor(1, "page")

    def answer(self, request: bytes) -> dict[str, Any]:
        """Answer one request of the page: ``id`` and ``image``; ``probes``, ``river`` or ``landmarks``."""
        number: object = None
        try:
            asked = _asked(request)
            number = asked.get("id")
            if "landmarks" in asked:
                return {"id": number, "calibration": self._calibration(asked)}
            if "river" in asked:
                return {"id": number, "river": self._river(asked)}
            probes = [probe_of(each, self.std_px) for each in asked["probes"]]
            found = self.view.measure(asked["image"], probes, with_budget=bool(asked.get("budget")))
            answer = {"id": number, "measurements": found}
            if asked.get("vertical") and probes:
                answer["vertical"] = self.view.vertical_px(asked["image"], probes[0])
        except AerodftError as error:
            return {"id": number, "error": str(error)}
        return answer

    def _calibration(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The camera's pose from landmarks, and from now on measured with where that is asked for."""
        use, given, unknowns = bool(asked.get("use")), asked["landmarks"], asked.get("unknowns")
        if use and self.access.is_read_only:
            raise UsageError("this page only shows", expected="one that was not opened read-only, to use a calibration")
        if not isinstance(given, list) or len(given) > _MOST_LANDMARKS:
            raise UsageError("the landmarks", expected=f"a list of at most {_MOST_LANDMARKS}")
        if not isinstance(unknowns, list) or not all(isinstance(each, str) for each in unknowns):
            raise UsageError("the unknowns", got=repr(unknowns)[:80], expected="a list of their names")
        return self.view.calibrate([landmark_of(each) for each in given], unknowns, use=use)

    def _river(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The river in an image, with the strokes of that or another image as hints."""
        told = asked["river"] if isinstance(asked["river"], dict) else {}
        hinted = told.get("image", asked["image"])
        if type(hinted) is not int:
            raise UsageError("the image of the strokes", got=repr(hinted)[:40], expected="its number")
        return self.view.river(asked["image"], hints_of(told), hinted)


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
    probes = asked.setdefault("probes", []) if {"river", "landmarks"} & asked.keys() else asked.get("probes")
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
        """JSON: ``title``, the camera's size, and ``stamp_ns`` and ``seconds`` of every image."""
        view = self.page.view
        camera = view.camera
        images = [asdict(each) | {"stamp_ns": str(each.stamp_ns)} for each in view.images]
        self.set_header("Content-Type", "application/json")
        self.write(
            orjson.dumps(
                {"title": view.title, "width_px": camera.width_px, "height_px": camera.height_px, "images": images}
            )
        )


class _Picture(_Guarded):
    """One image."""

    async def get(self, number: str) -> None:
        """JPEG.

        Raises:
            HTTPError: 404: there is none, or it is damaged.
        """
        loop = asyncio.get_running_loop()
        try:
            data = await loop.run_in_executor(self.page.worker, self.page.view.jpeg, int(number))
        except AerodftError as error:
            raise HTTPError(404, reason=str(error).encode("ascii", "replace").decode()) from error
        self.set_header("Content-Type", "image/jpeg")
        self.write(data)


class _Measuring(_Guarded, WebSocketHandler):
    """Measures as the pointer moves: one request at a time, so that none pile up."""

    def check_origin(self, origin: str) -> bool:
        """See ``Access``; a browser always says where a WebSocket comes from."""
        return self.page.access.allows_origin(origin, self.request.headers.get("Host", ""))

    async def on_message(self, message: str | bytes) -> None:
        """Answer; the next message is read when this one is answered."""
        data = message.encode() if isinstance(message, str) else message
        answer = await asyncio.get_running_loop().run_in_executor(self.page.worker, self.page.answer, data)
        await self.write_message(orjson.dumps(answer).decode())


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
        page.worker.shutdown(cancel_futures=True)
