"""Damaged and unfinished recordings made whole in place."""

from aerodft.adapters.recording.recover.recovery import (
    DataLoss,
    Recovery,
    SegmentRecovery,
    is_recording,
    recordings_in,
    recover_folder,
)
