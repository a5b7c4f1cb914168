"""The registry of telemetry log formats, and what opens and decodes a log of any of them.

A new format is a module that has what ``LogFormat`` says, and one line here.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from aerodft.adapters.files import check_is_no_pipe, looks_like
from aerodft.adapters.telemetry import dataflash, dataflash_text, gpmf, klv, photographs, subtitles, tables, tlog, ulog
from aerodft.adapters.telemetry.data_tracks import is_video
from aerodft.adapters.telemetry.log_file import (
    HEAD_BYTES,
    FolderFormat,
    FrameNames,
    LogFile,
    LogFormat,
    LogSource,
    NamesFrames,
    VideoFormat,
)
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.tracks import scaled
from aerodft.errors import InputError, os_errors_as
from aerodft.model import GimbalTrack, RawBlock, Track
from aerodft.service import TelemetryDecoder, TelemetrySettings

LOG_FORMATS: Final[list[LogFormat]] = [
    tlog,
    dataflash,
    dataflash_text,
    ulog,
    photographs,
    klv,
    gpmf,
    subtitles,
    tables,
]
"""Asked in this order whether a file is theirs."""

USED_MESSAGES: Final[frozenset[str]] = ulog.USED_MESSAGES
"""Messages that poses are made of, of the formats whose decoders name their frames."""

_Decoder = TypeVar("_Decoder")


class CompositeDecoder:
    """Decodes each block by its protocol; a ``service.ports.TelemetryDecoder``.

    Args:
        followed: The vehicle to follow; None for the first one heard.
    """

    def __init__(self, followed: FollowedIds | None = None) -> None:
        followed = followed or FollowedIds()
        self._angle_scales = followed.angle_scales
        self._decoders: dict[str, TelemetryDecoder] = {
            each.PROTOCOL: each.new_decoder(followed) for each in LOG_FORMATS
        }

    @property
    def rejected(self) -> Counter[str]:
        """Rows left out so far, by ``MESSAGE: reason``."""
        rejected: Counter[str] = Counter()
        for decoder in self._decoders.values():
            rejected.update(decoder.rejected)
        return rejected

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames.

        Raises:
            InputError: No format of this protocol is known here.
        """
        tracks = self._decoder_of(block).decode(block)
        return tuple(map(self._scaled, tracks)) if self._angle_scales else tracks

    def _scaled(self, track: Track) -> Track:
        """A gimbal's track with the configured factors of its angles, whatever the format; others as they are."""
        scale = self._angle_scales.get(track.source) if isinstance(track, GimbalTrack) else None
        return track if scale is None or not isinstance(track, GimbalTrack) else scaled(track, scale)

    def _decoder_of(self, block: RawBlock) -> TelemetryDecoder:
        decoder = self._decoders.get(block.protocol)
        if decoder is None:
            known = " or ".join(self._decoders)
            raise InputError("telemetry of an unknown format", where=block.sender, got=block.protocol, expected=known)
        return decoder

    def frame_names(self, block: RawBlock) -> FrameNames:
        """Key of each of a block's frames ``(n,)``, and what they are called by key; one name where nobody knows more.

        Raises:
            InputError: No format of this protocol is known here.
        """
        decoder = self._decoder_of(block)
        if isinstance(decoder, NamesFrames):
            return decoder.frame_names(block)
        return np.zeros(len(block.offset), dtype=np.int64), {0: block.protocol}

    def of_type(self, kind: type[_Decoder]) -> _Decoder:
        """The decoder of this type."""
        return next(each for each in self._decoders.values() if isinstance(each, kind))


def decoder_of(telemetry: TelemetrySettings | None) -> CompositeDecoder:
    """The decoder that follows the vehicle of a station."""
    return CompositeDecoder(followed_by(telemetry))


def followed_by(telemetry: TelemetrySettings | None) -> FollowedIds:
    """The vehicle of a station, and how its gimbals' angles are read."""
    if telemetry is None:
        return FollowedIds()
    return FollowedIds(
        system=telemetry.system,
        component=telemetry.component,
        gimbal=telemetry.gimbal,
        angle_scales={str(source): scale for source, scale in telemetry.attitude.scale},
        gps_lon_first=telemetry.gps_lon_first,
    )


def carries_telemetry(path: Path) -> bool:
    """Whether a path is a video with telemetry in a data track."""
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            return _video_format(path, file.read(HEAD_BYTES)) is not None
    except OSError:
        return False


def _video_format(path: Path, head: bytes) -> LogFormat | None:
    """The format of the telemetry in a data track of a video that begins with these bytes; None where it has none."""
    formats = (each for each in LOG_FORMATS if isinstance(each, VideoFormat)) if is_video(head) else ()
    return next((each for each in formats if each.recognises_video(path)), None)


def open_log(path: Path, columns: Mapping[str, str] | None = None) -> LogSource:
    """Open a telemetry log by what it holds, whatever its name; a folder, where a format's logs may be folders.

    Args:
        path: The file or folder.
        columns: A station's names of a table's columns; None or empty for known tools' only.

    Raises:
        InputError: It is missing, empty, unreadable, or of none of the formats.
    """
    expected = " or ".join(each.TITLE for each in LOG_FORMATS)
    if columns and path.is_file() and looks_like(path) == "text":
        return tables.TableLog(path, columns)
    if path.is_dir():
        with os_errors_as("cannot be read", where=path, expected=expected):
            folders = [each for each in LOG_FORMATS if isinstance(each, FolderFormat) and each.recognises_folder(path)]
        if folders:
            return folders[0].open_source(path)
    head = LogFile(path, expected).read(0, HEAD_BYTES)
    found = _video_format(path, head) or next((each for each in LOG_FORMATS if each.recognises(head)), None)
    if found is None:  # what is damaged at its beginning may be a .tlog farther on
        return tlog.TlogSource(path, expected)
    return found.open_source(path)
