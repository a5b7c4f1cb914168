"""Recordings played at a chosen pace, on the bus and on a MAVLink link."""

from replay.player.merged_timeline import AnyRecording, TimelineMessage, name_of, timeline
from replay.player.player import Controls, Outlet, Player
from replay.player.publish import (
    MavlinkOut,
    Republisher,
    check_mavlink,
    holds_mavlink,
    is_published,
    keys_of,
    shifted,
)
