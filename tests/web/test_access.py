"""Whoever is not the page itself, or has no token, is refused; what is asked must be sound."""

import asyncio
import json
import re
import select
import socket
import time
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from aerodft.errors import UsageError
from aerodft.web import Access
from tests.commands import run_aerodft
from tests.web.pages import opened_page

MOST_CONNECTIONS = 64
RECORDING = "tests/cli/frozen-0.1"
EVERYWHERE = "0.0.0.0"  # noqa: S104 - what is tested


@pytest.fixture(scope="module")
def page():
    with opened_page(RECORDING) as address:
        yield address


def fetched(address, **headers):
    """Status, headers and content."""
    to = urlsplit(address)
    link = HTTPConnection(to.hostname, to.port, timeout=60)
    try:
        link.request("GET", f"{to.path}?{to.query}", headers=headers)
        answer = link.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        link.close()


def asked(address, message, **headers):
    """The answer to one message on the page's WebSocket."""

    async def talk():
        request = HTTPRequest(address.replace("http:", "ws:") + "measure", headers=headers)
        link = await websocket_connect(request)
        await link.write_message(message)
        answer = await link.read_message()
        link.close()
        while answer is not None and await link.read_message() is not None:
            pass
        return answer

    answer = asyncio.run(talk())
    return None if answer is None else json.loads(answer)


def test_the_page_comes_with_a_strict_policy(page):
    status, headers, content = fetched(page)
    assert status == 200
    assert b"<canvas" in content
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "Access-Control-Allow-Origin" not in headers
    assert not re.search(rb"https?://|style=|onclick=", content)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "10.1.2.3", ""])
def test_a_name_that_somebody_made_point_here_is_refused(page, host):
    assert fetched(page + "view.json", Host=host)[0] in {400, 403}


def test_another_site_is_refused(page):
    assert fetched(page + "view.json", Origin="http://evil.example")[0] == 403
    with pytest.raises(HTTPClientError, match="403"):
        asked(page, "{}", Origin="http://evil.example")


@pytest.mark.parametrize(
    "path", ["../server.py", "%2e%2e/server.py", "..%2fserver.py", "/etc/passwd", "page.js/../../access.py"]
)
def test_no_file_beside_the_page_s_own_is_read(page, path):
    status, _, content = fetched(page + path)
    assert status in {403, 404}
    assert b"import" not in content


@pytest.mark.parametrize(
    "path", ["images/99999.jpg", "images/-1.jpg", "images/x.jpg", "images/999999999999.jpg", "%00", "a" * 5000]
)
def test_an_image_that_is_not_there_is_refused(page, path):
    assert fetched(page + path)[0] == 404


@pytest.mark.parametrize(
    "message",
    [
        "no JSON", "[]", "{}", '{"image": 0}', '{"image": "0", "probes": []}', '{"image": 0, "probes": [7]}',
        '{"image": 0, "probes": [{"kind": "width", "pixels": [[NaN, 1], [2, 3]]}]}',
        '{"image": 0, "probes": [{"kind": "width", "pixels": [[1e999, 1], [2, 3]]}]}',
        '{"image": 0, "probes": [{"kind": "width", "pixels": [[1e300, 1], [2, 3]]}]}',
        '{"image": 0, "probes": [{"kind": "width", "pixels": [["1", 1], [2, 3]]}]}',
        '{"image": 0, "probes": [{"kind": "width", "pixels": [[1, 1]]}]}',
        '{"image": 0, "probes": [{"kind": "__class__", "pixels": [[1, 1]]}]}',
        '{"image": 0, "probes": [{"kind": "range", "pixels": [[1, 1]], "name": "a b"}]}',
        '{"image": 0, "probes": [{"kind": "range", "pixels": [[1, 1]], "std_px": 0}]}',
        '{"image": 0, "river": 7}', '{"image": 0, "river": {"water": 7, "land": []}}',
        '{"image": 0, "river": {"water": [[[NaN, 1]]], "land": []}}',
        '{"image": 0, "river": {"water": [[]], "land": []}}',
        '{"image": 0, "river": {"water": [], "land": [], "image": "1"}}',
        '{"image": 0, "evidence": 7, "unknowns": []}', '{"image": 0, "evidence": {}, "unknowns": [7]}',
        '{"image": 0, "evidence": {"image": {"file": "/etc/passwd"}}, "unknowns": ["tilt"]}',
        '{"image": 0, "evidence": {"landmark": [{"name": "a", "pixel": [NaN, 1]}]}, "unknowns": ["tilt"]}',
        '{"image": 0, "evidence": {"landmark": [{"name": "a", "image": "/etc/passwd"}]}, "unknowns": ["tilt"]}',
        '{"image": 0, "evidence": {"horizon": [{"name": "a", "pixels": [[1, 1]]}]}, "unknowns": ["tilt"]}',
        '{"image": 0, "import": 7}', '{"image": 0, "import": "x"}', '{"image": 0, "save": {"kind": "width"}}',
        '{"image": 99999, "probes": [{"kind": "range", "pixels": [[1, 1]]}]}',
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_answered_with_a_sentence(page, message):
    answer = asked(page, message)
    assert set(answer) == {"id", "error"}
    assert "Traceback" not in answer["error"]


def test_a_message_that_is_too_long_ends_the_connection_and_nothing_else(page):
    assert asked(page, "[" + "0," * 100_000 + "0]") is None
    assert fetched(page)[0] == 200


def test_idle_connections_leave_the_station_its_descriptors(page):
    place, idle = urlsplit(page), []
    try:
        idle += [socket.create_connection((place.hostname, place.port), timeout=5) for _ in range(200)]
        deadline = time.monotonic() + 8
        while len(closed := select.select(idle, [], [], 0.2)[0]) < len(idle) - MOST_CONNECTIONS:
            assert time.monotonic() < deadline
        assert len(closed) == len(idle) - MOST_CONNECTIONS
        next(each for each in idle if each not in closed).close()
        assert fetched(page + "view.json")[0] == 200
    finally:
        for each in idle:
            each.close()


def test_what_doctor_says_is_the_command_line_s(page):
    status, _, content = fetched(page + "doctor.json")
    assert status == 200
    assert json.loads(content)["problems"] == run_aerodft("doctor", RECORDING, "--json").json["problems"]


def test_of_elsewhere_only_the_tiles_that_were_named_are_loaded():
    access = Access.at("127.0.0.1", 0, tiles="https://tiles.example:8443/a/{z}/{x}/{y}.png")
    assert "img-src 'self' blob: https://tiles.example:8443;" in access.headers["Content-Security-Policy"]
    for wrong in (
        "https://tiles.example/{z}/{x}.png",
        "javascript:{z}{x}{y}",
        "https://a b/{z}/{x}/{y}",
        "//a/{z}/{x}/{y}",
    ):
        with pytest.raises(UsageError, match="`tiles`"):
            Access.at("127.0.0.1", 0, tiles=wrong)


def test_a_page_that_only_shows_uses_no_calibration(tmp_path):
    picture = tmp_path / "bridge.jpg"
    picture.write_bytes(Path("configs/calibration/bridge.jpg").read_bytes())
    ask = {"image": 0, "evidence": {}, "unknowns": ["tilt"], "use": True}
    with opened_page(picture, "--camera", "configs/cameras/demo-1080p.toml", "--read-only") as address:
        assert "only shows" in asked(address, json.dumps(ask))["error"]
    assert not list(tmp_path.glob("*.toml"))


def test_beyond_this_machine_a_token_is_asked_for():
    with opened_page(RECORDING, "--host", EVERYWHERE) as address:
        base, token = address.replace(EVERYWHERE, "127.0.0.1").split("?token=")
        assert len(token) >= 30
        for wrong in ("view.json", "view.json?token=", f"view.json?token={token[:-1]}~", "images/0.jpg", "page.js"):
            assert fetched(base + wrong)[0] == 403, wrong
        with pytest.raises(HTTPClientError, match="403"):
            asked(base, "{}")
        status, headers, _ = fetched(f"{base}view.json?token={token}")
        assert status == 200
        assert "HttpOnly" in headers["Set-Cookie"]
        assert fetched(base + "view.json", Cookie=f"aerodft_token={token}")[0] == 200
        assert fetched(f"{base}view.json?token={token}", Host="evil.example")[0] == 403
