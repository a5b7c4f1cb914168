"""Camera and calibration files: lens, telemetry biases, and the pose of a fixed camera."""

from aerodft.adapters.config.camera.calibration_file import (
    BiasTable,
    CalibrationFile,
    KnownPointTable,
    bias_table,
    biases_from,
    load_calibration,
    write_calibration,
)
from aerodft.adapters.config.camera.camera_file import (
    CameraTable,
    KnownCamera,
    camera_document,
    camera_from,
    known_cameras,
    load_camera,
)
from aerodft.adapters.config.camera.fixed_pose import (
    FixedPose,
    PoseTable,
    StdTable,
    fixed_pose_from,
    place_in_enu,
    pose_sample,
    stds_from,
)
