"""Camera and calibration files: lens, telemetry biases, and the pose of a fixed camera."""

from aerodft.adapters.config.camera.calibration_file import (
    BiasTable,
    CalibrationFile,
    bias_table,
    biases_from,
    load_calibration,
    write_calibration,
)
from aerodft.adapters.config.camera.camera_file import CameraTable, camera_document, camera_from, load_camera
from aerodft.adapters.config.camera.fixed_pose import FixedPose, PoseTable, fixed_pose_from, place_in_enu, pose_sample
from aerodft.adapters.config.camera.library import KnownCamera, known_cameras
from aerodft.adapters.config.camera.stds import StdTable, stds_from
