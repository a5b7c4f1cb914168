"""Who may open the page: loopback alone, or whoever has the token; and what a browser may do with it."""

import hmac
import secrets
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Final, Self
from urllib.parse import urlsplit

from aerodft.errors import UsageError

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self';"
        " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
"""What the page is sent with: nothing from elsewhere is loaded, and nobody else may read or frame it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Who may open the page.

    Attributes:
        host: Address that is listened on.
        port: 0 for one that is free.
        token: What a request must bring; None where only this machine can ask.
        is_read_only: Whether people may look and measure, and change nothing.
    """

    host: str
    port: int
    token: str | None
    is_read_only: bool = False

    @classmethod
    def at(cls, host: str, port: int, *, is_read_only: bool = False) -> Self:
        """Access at an address: with a new random token, unless it is of the loopback interface.

        Raises:
            UsageError: The host is no address.
        """
        try:
            is_loopback = ip_address(host).is_loopback
        except ValueError:
            raise UsageError("`host`", got=host, expected="an IP address, such as 127.0.0.1 or 0.0.0.0") from None
        token = None if is_loopback else secrets.token_urlsafe(24)
        return cls(host=host, port=port, token=token, is_read_only=is_read_only)

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


def _hostname(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""
