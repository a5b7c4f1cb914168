"""Recordings by their path: aerodft's own, and any other tool's."""

from pathlib import Path
from typing import Final

from aerodft.adapters.config.inputs import Topics
from aerodft.adapters.mcap.scanning import scan_segment
from replay.foreign import ForeignRecording
from replay.recording import Recording
from replay.segments import channels_of, is_mcap

OWN_SCHEMAS: Final = "aerodft."


def is_foreign(path: Path) -> bool:
    """Whether another tool's recording is there, rather than a folder that aerodft wrote.

    Raises:
        InputError: A file cannot be read.
    """
    if path.is_dir():
        return is_mcap(path) and next(path.glob("data_*.mcap"), None) is None
    return is_mcap(path) and not _is_own(path)


def open_recording(path: Path, topics: Topics | None = None) -> Recording | ForeignRecording:
    """Open whatever recording is there.

    Args:
        path: A recording's folder, an MCAP file, or a folder of MCAP files.
        topics: What is known of another tool's topics.

    Raises:
        InputError: There is none, or it cannot be read.
        NoAnswerError: It holds nothing.
    """
    return ForeignRecording(path, topics) if is_foreign(path) else Recording(path)


def _is_own(path: Path) -> bool:
    segment = scan_segment(path)
    segment.left_out.update(chunk.offset for chunk in segment.chunks)  # whoever reads on says what is damaged
    channels = channels_of(segment).values()
    return any(channel.schema.startswith(OWN_SCHEMAS) for channel in channels)
