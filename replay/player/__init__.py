"""Recordings played at a chosen pace, on the bus and on a MAVLink link."""

from replay.player.player import Controls, Outlet, Player, TimelineMessage, timeline
from replay.player.publish import MavlinkOut, Republisher, check_mavlink, is_published, shift_stamps
