"""The likely mistake in evidence that does not fit."""

from calibration.diagnosis.causes import Attempt, likely_mistake
