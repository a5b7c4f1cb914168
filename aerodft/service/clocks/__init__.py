"""Maps to UTC from the vehicle's clock since boot, this machine's clock and the camera's."""

from aerodft.service.clocks.camera_clock import ImageClock, MappedToUtc, WallClock
from aerodft.service.clocks.clock_map import HOST_STD_S, ClockHealth, ClockMap
from aerodft.service.clocks.log_span import PAUSE_NS, LogSpan, survey_span
from aerodft.service.clocks.stated_offset import JUMP_NS
from aerodft.service.clocks.tracks_by_tick import Ticks, grouped_by_stream
