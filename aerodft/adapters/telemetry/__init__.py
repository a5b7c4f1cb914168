"""Telemetry logs and links, whatever their format, decoded to tracks in SI units."""

from aerodft.adapters.telemetry.data_tracks import DataTrackLog
from aerodft.adapters.telemetry.dataflash import FMT_TYPE, HEAD_SIZE, DataflashDecoder, MessageFormat
from aerodft.adapters.telemetry.log_file import LogFormat, LogSource
from aerodft.adapters.telemetry.log_formats import (
    LOG_FORMATS,
    USED_MESSAGES,
    CompositeDecoder,
    carries_telemetry,
    decoder_of,
    followed_by,
    open_log,
)
from aerodft.adapters.telemetry.mavlink import (
    SignatureCheck,
    SigningCounts,
    SigningState,
    load_key,
    opened_signing,
    signing_document,
    signing_sentences,
    unchecked_sentence,
)
from aerodft.adapters.telemetry.photographs import PROTOCOL as PHOTOGRAPHS
from aerodft.adapters.telemetry.photographs import PhotographLog
from aerodft.adapters.telemetry.subtitles import SubtitleLog, are_subtitles, carries_subtitles, hfov_deg, unread_tracks
from aerodft.adapters.telemetry.tables import COLUMN_KEYS
from aerodft.adapters.telemetry.tlog import TlogSource
from aerodft.adapters.telemetry.tracks import MOST_ATTACHED
