"""Serial devices."""

import contextlib
import logging
import selectors
from typing import Final

import serial

from aerodft.adapters.mavlink.address import LinkAddress
from aerodft.adapters.mavlink.datagrams import Reads

_LOG: Final = logging.getLogger(__name__)


class SerialTransport:
    """A serial device; comes back by itself after it was unplugged.

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        self._device, self._baud = address.host, address.port
        self._port: serial.Serial | None = self._open()

    def _open(self) -> serial.Serial:
        return serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)

    def read(self, timeout_s: float) -> Reads:
        """What has arrived; tries to open the device again where it was lost."""
        if self._port is None:
            with contextlib.suppress(OSError):
                self._port = self._open()
                _LOG.info("%s is back", self._device)
        if self._port is None:
            with selectors.DefaultSelector() as selector:
                selector.select(timeout_s)
            return []
        try:
            self._port.timeout = timeout_s
            data = self._port.read(1)
            data += self._port.read(self._port.in_waiting)
        except OSError as error:
            _LOG.warning("%s is lost (%s); trying again", self._device, error.strerror or error)
            self.close()
            return [(self._device, b"")]
        return [(self._device, data)] if data else []

    def write(self, data: bytes) -> None:
        """Send, if the device is there."""
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.write(data)

    def write_to(self, sender: str, data: bytes) -> None:  # noqa: ARG002 - there is but one at the other end
        """Send, if the device is there."""
        self.write(data)

    def close(self) -> None:
        """Give the device back."""
        if self._port is not None:
            self._port.close()
            self._port = None
