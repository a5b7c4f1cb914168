"""Subtitles of drones (.SRT): telemetry in a video's subtitles, beside it or inside it, of every known dialect."""

from pathlib import Path

from aerodft.adapters.files import check_is_no_pipe
from aerodft.adapters.telemetry.log_file import HEAD_BYTES
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.subtitles.cues import find_cues
from aerodft.adapters.telemetry.subtitles.decoding import PROTOCOL, SubtitleDecoder, hfov_deg
from aerodft.adapters.telemetry.subtitles.source import TITLE, SubtitleLog, carries_subtitles, unread_tracks

__all__ = [
    "PROTOCOL",
    "TITLE",
    "SubtitleDecoder",
    "SubtitleLog",
    "are_subtitles",
    "carries_subtitles",
    "hfov_deg",
    "new_decoder",
    "open_source",
    "recognises",
    "unread_tracks",
]


def recognises(head: bytes) -> bool:
    """Whether a cue's number and time, or number and date, stand at the beginning; or a video does."""
    return head[4:8] == b"ftyp" or any(start < len(head) for start, _ in find_cues(head)[:1])


def are_subtitles(path: Path) -> bool:
    """Whether a path is a file that begins like subtitles, or like a video."""
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            return recognises(file.read(HEAD_BYTES))
    except OSError:
        return False


def open_source(path: Path) -> SubtitleLog:
    """Subtitles, or a video with them, as blocks of cues."""
    return SubtitleLog([path])


def new_decoder(followed: FollowedIds) -> SubtitleDecoder:
    """A decoder of cues, which takes the stated order of coordinates where there is one."""
    return SubtitleDecoder(gps_lon_first=followed.gps_lon_first)
