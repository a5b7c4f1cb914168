"""Who may open the page: loopback alone, or whoever has the token; and what a browser may do with it."""

import hmac
import re
import secrets
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Final, Self
from urllib.parse import urlsplit

from aerodft.errors import UsageError

_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:{tiles}; connect-src 'self';"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS: Final = {
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
_TILE_PARTS: Final = ("{z}", "{x}", "{y}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Who may open the page.

    Attributes:
        host: Address that is listened on.
        port: 0 for one that is free.
        token: What a request must bring; None where only this machine can ask.
        is_read_only: Whether people may look and measure, and change nothing.
        tiles: Address of a tile server's pictures, with ``{z}``, ``{x}`` and ``{y}``; None for no map but the grid.
    """

    host: str
    port: int
    token: str | None
    is_read_only: bool = False
    tiles: str | None = None

    @classmethod
    def at(cls, host: str, port: int, *, is_read_only: bool = False, tiles: str | None = None) -> Self:
        """Access at an address: with a new random token, unless it is of the loopback interface.

        Raises:
            UsageError: The host is no address, or that of the tiles names no pictures.
        """
        if tiles is not None and not (_origin(tiles) and all(part in tiles for part in _TILE_PARTS)):
            expected = "an address such as https://tiles.example/{z}/{x}/{y}.png"
            raise UsageError("`tiles`", got=tiles, expected=expected)
        try:
            is_loopback = ip_address(host).is_loopback
        except ValueError:
            raise UsageError("`host`", got=host, expected="an IP address, such as 127.0.0.1 or 0.0.0.0") from None
        token = None if is_loopback else secrets.token_urlsafe(24)
        return cls(host=host, port=port, token=token, is_read_only=is_read_only, tiles=tiles)

    @property
    def headers(self) -> dict[str, str]:
        """What the page is sent with: only tiles are loaded from elsewhere, and nobody else may read or frame it."""
        tiles = "" if self.tiles is None else f" {_origin(self.tiles)}"
        return {"Content-Security-Policy": _POLICY.format(tiles=tiles), **_HEADERS}

    def allows_host(self, header: str) -> bool:
        """Whether a request's ``Host`` can be this page; a name that another site made point here cannot."""
        name = _hostname(f"//{header}")
        try:
            address = ip_address(name)
        except ValueError:
            return name == "localhost"
        return address.is_loopback or self.token is not None

    def allows_origin(self, origin: str | None, host_header: str) -> bool:
        """Whether a request comes from the page itself; browsers say so of everything that could change something."""
        return origin is None or origin in {f"http://{host_header}", f"https://{host_header}"}

    def allows_token(self, given: str | None) -> bool:
        """Whether a request brings the token, where one is needed."""
        return self.token is None or (given is not None and hmac.compare_digest(given.encode(), self.token.encode()))

    def address(self, port: int) -> str:
        """What to open in a browser, with the port that was got."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/" + (f"?token={self.token}" if self.token else "")


def _origin(url: str) -> str:
    """Scheme and host with port of a tile's address, as a policy names it; empty where it is none."""
    found = re.match(r"https?://[A-Za-z0-9.\-]+(:\d+)?(?=/)", url)
    return found[0] if found else ""


def _hostname(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""
