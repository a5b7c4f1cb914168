"""Surveyed markers (ArUco, AprilTag) found in images."""
