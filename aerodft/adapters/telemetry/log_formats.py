"""One decoder for all protocols, and one way to open a log of any of them."""

from collections import Counter
from pathlib import Path

from aerodft.adapters.telemetry.dataflash import HEAD, DataflashDecoder
from aerodft.adapters.telemetry.logs import DataflashSource, LogFile, TlogSource
from aerodft.adapters.telemetry.mavlink import Followed, MavlinkDecoder
from aerodft.model import RawBlock, Track, WireProtocol
from aerodft.service import TelemetrySettings


class CompositeDecoder:
    """Decodes each block by its protocol; a ``service.ports.TelemetryDecoder``.

    Args:
        followed: The vehicle to follow; None for the first one heard.
    """

    def __init__(self, followed: Followed | None = None) -> None:
        self.mavlink = MavlinkDecoder(followed)
        self.dataflash = DataflashDecoder()

    @property
    def rejected(self) -> Counter[str]:
        """Rows left out so far, by ``MESSAGE: reason``."""
        return self.mavlink.rejected + self.dataflash.rejected

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames."""
        decoder = self.mavlink if block.protocol is WireProtocol.MAVLINK else self.dataflash
        return decoder.decode(block)


def decoder_of(telemetry: TelemetrySettings | None) -> CompositeDecoder:
    """The decoder that follows the vehicle of a station."""
    return CompositeDecoder(followed_by(telemetry))


def followed_by(telemetry: TelemetrySettings | None) -> Followed:
    """The vehicle of a station."""
    if telemetry is None:
        return Followed()
    return Followed(system=telemetry.system, component=telemetry.component, gimbal=telemetry.gimbal)


def open_log(path: Path) -> TlogSource | DataflashSource:
    """Open a telemetry log by what it holds, whatever its name.

    Raises:
        InputError: It is missing, empty, unreadable, or neither a .tlog nor an ArduPilot .bin log.
    """
    head = LogFile(path).read(0, len(HEAD))
    return DataflashSource(path) if head == bytes(HEAD) else TlogSource(path)
