"""Calibration of a flight's telemetry biases from landmarks in many images."""

from calibration.flight.biases import BiasCalibrator, BiasedPoses, BiasModel, propagated, relocated, stds_of
from calibration.flight.result import ImagesResult, calibrate_images
from calibration.flight.state import PoseTrack, View, shared_and_new, typical_noise
