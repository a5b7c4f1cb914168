"""Clocks: the vehicle's since boot, this machine's and the camera's, each mapped to UTC."""

from aerodft.service.clocks.camera_clock import ImageClock, OnClock, WallClock
from aerodft.service.clocks.clock_map import HOST_STD_S, ClockHealth, ClockMap
from aerodft.service.clocks.log_span import PAUSE_NS, LogSpan, survey_span
from aerodft.service.clocks.stated_offset import JUMP_NS
from aerodft.service.clocks.tracks_by_tick import Ticks, grouped_by_stream
