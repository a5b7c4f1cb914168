"""A signed link's check, from its settings to its end."""

from collections.abc import Iterator
from contextlib import contextmanager

from aerodft.adapters.telemetry import SignatureCheck, open_signing
from aerodft.service import SigningSettings
from aerodft.service.clocks import WallClock


@contextmanager
def opened_signing(settings: SigningSettings | None) -> Iterator[SignatureCheck | None]:
    """The check, closed at the end; None without settings.

    Raises:
        ConfigError: The key cannot be used.
        InputError: The time stamps cannot be kept.
    """
    if settings is None:
        yield None
        return
    # Read anew each time: the first time synchronisation after boot must reach the signatures.
    check = open_signing(settings, lambda: WallClock().now_ns())
    try:
        yield check
    finally:
        check.close()
