"""What pymavlink finds in ``.bin`` logs."""

from collections.abc import Iterator
from pathlib import Path

from pymavlink import DFReader


def messages_by_pymavlink(path: Path) -> Iterator[tuple[int, int]]:
    """Where each message that DFReader gives starts and ends."""
    log = DFReader.DFReader_binary(str(path), zero_time_base=False)
    while log._parse_next() is not None:  # noqa: SLF001 - the one reader of its kind that says where a message is
        yield log.offset - log.formats[log.prev_type].len, log.offset
    log.filehandle.close()
    log.data_map.close()
