"""Camera and calibration files: lens, telemetry biases, and the pose of a fixed camera."""

from aerodft.adapters.config.camera.bias_tables import BiasTable, bias_table, biases_from
from aerodft.adapters.config.camera.calibration import CalibrationFile, load_calibration, write_calibration
from aerodft.adapters.config.camera.camera import CameraTable, camera_document, camera_from, load_camera
from aerodft.adapters.config.camera.fixed_pose import FixedPose, placed, pose_sample
from aerodft.adapters.config.camera.pose_tables import PoseTable, fixed_pose_from, pose_table
