"""A video aligned with a log by how the camera turned."""

from calibration.sync.alignment import Alignment, align, check_overlap
