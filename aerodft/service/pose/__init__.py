"""Camera poses at image stamps from attitude, height and position, or the reason for none."""

from aerodft.service.pose.composition import ground_below, raised_by_ground
from aerodft.service.pose.source import PoseSource
from aerodft.service.pose.water_level import over_water
from aerodft.service.pose.zoom import LEVEL_SLACK, hfov_difference_std_rad
