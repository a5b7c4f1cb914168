"""Starts from landmarks: none where there is none, whatever the landmarks."""

import numpy as np

from aerodft.model.camera import Camera
from aerodft.model.evidence import EvidenceSet, Landmark
from aerodft.model.measurement import ProjectionModel
from calibration.residuals import Problem
from calibration.result import start_state, unknowns_of
from calibration.starts import placed

CAMERA = Camera.from_fov(name="wide", width_px=1920, height_px=1080, hfov_rad=1.08, vfov_rad=0.66)
POSE = ("east", "north", "height", "tilt", "roll", "heading")


def test_pixels_taken_for_places_give_no_start():
    """Four points of a plane, all but one pixel together: OpenCV's plane method gives neither poses nor errors."""
    places_m = [(559.1, 1061.8, 0.0), (1444.9, 889.2, 0.0), (555.8, 390.6, 1.0), (1376.6, 374.1, 0.0)]
    pixels = [(7.6, 9.8), (15.8, 7.2), (16.1, 25.6), (31.1, 17.8)]
    evidence = tuple(
        Landmark(name=f"p{index}", pixel=pixel, position_m=place_m, std_px=1.0, std_m=(0.0, 0.0, 0.0))
        for index, (pixel, place_m) in enumerate(zip(pixels, places_m, strict=True))
    )
    known = EvidenceSet(evidence=evidence, priors={})
    problem = Problem(known, unknowns_of(POSE, known, CAMERA, ProjectionModel.PINHOLE), ProjectionModel.PINHOLE)
    starts = list(placed(problem, start_state({}, CAMERA, ProjectionModel.PINHOLE), 1.0))
    assert all(np.all(np.isfinite(start.position_m)) for start in starts)
