"""Recordings as MCAP segments: written so that a crash costs half a second, read as far as they are whole."""

from aerodft.adapters.recording.channels import (
    RECORDING_KEY,
    SENDER_KEY,
    Channel,
    ChannelMessage,
    is_raw,
    protobuf_channel,
)
from aerodft.adapters.recording.layout import MAGIC, RECORD_HEAD, ChunkBuffer, Registry, encode_records
