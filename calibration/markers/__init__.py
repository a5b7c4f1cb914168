"""Surveyed markers (ArUco, AprilTag) found in images."""

from calibration.markers.detection import MIN_SIDE_PX, CameraPlace, MarkerObserver, find_markers, other_dictionary
from calibration.markers.geometry import Judgement, Miss, judge
