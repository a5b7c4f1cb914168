"""Starts from landmarks: none where there is none, whatever the landmarks."""

import numpy as np

from aerodft.model import Camera, EvidenceSet, Landmark, ProjectionModel
from calibration.pose import Problem, start_state, unknowns_of
from calibration.pose.solve import closed_form_states

CAMERA = Camera(name="field", width_px=1920, height_px=1080, fx_px=1600.0, fy_px=1600.0, cx_px=959.5, cy_px=539.5)
POSE = ("east", "north", "height", "tilt", "roll", "heading")


def test_pixels_taken_for_places_give_no_start_by_the_method_for_planes():
    """OpenCV's method for points of a plane gives neither poses nor errors for these."""
    places_m = np.array(
        [[-365.09389, -27.42032, -0.04913], [205.85077, 35.74844, 0.03506], [-131.53338, -339.74512, -0.13732]]
        + [[290.77651, 331.41699, 0.15139]]
    )
    flat = np.array([[-0.606604, -0.329323], [-0.603424, -0.334491], [-0.593356, -0.318820], [-0.607371, -0.338100]])
    pixels = flat * CAMERA.fx_px + [CAMERA.cx_px, CAMERA.cy_px]
    evidence = tuple(
        Landmark(name=f"p{index}", pixel=tuple(pixel), position_m=tuple(place_m))
        for index, (pixel, place_m) in enumerate(zip(pixels.tolist(), places_m.tolist(), strict=True))
    )
    known = EvidenceSet(evidence=evidence, priors={})
    problem = Problem(known, unknowns_of(POSE, known, CAMERA, ProjectionModel.PINHOLE), ProjectionModel.PINHOLE)
    starts = list(closed_form_states(problem, start_state({}, CAMERA, ProjectionModel.PINHOLE), 1.0))
    assert len(starts) <= 1
    assert all(np.all(np.isfinite(start.position_m)) for start in starts)
