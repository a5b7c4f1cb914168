"""A video aligned with a log by how the camera turned, and photos by the log's triggers."""

from calibration.sync.alignment import Alignment, align, check_overlap
from calibration.sync.triggers import PhotoMatches, match_photos
