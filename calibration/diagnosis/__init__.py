"""Likely mistakes in evidence that fits no camera, found by solving with what may have been meant."""

from calibration.diagnosis.likely_mistakes import Attempt, likely_mistake
