"""A camera's pose and lens, or a flight's telemetry biases, from files of what people know of a scene."""

from aerodft.app.calibrate.markers import detected_evidence
from aerodft.app.calibrate.solve import CalibrationResult, calibrate
