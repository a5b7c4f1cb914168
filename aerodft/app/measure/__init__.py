"""Measuring in one image: camera, pose, ground and probes to measurements."""

from aerodft.app.measure.measurements import (
    Area,
    Bearing,
    Distance,
    Height,
    ImageProbe,
    Length,
    Position,
    Range,
    RiverWidth,
    Width,
    ground_points,
    measure,
    measured_document,
    probe,
    probe_classes,
    project,
    requests_of,
)
from aerodft.app.measure.photograph import (
    UNSTATED_HOME_STD_M,
    Photograph,
    StatedPose,
    camera_of_photograph,
    carries_pose,
    lens_in_photograph,
    read_photograph,
)
from aerodft.app.measure.scene import (
    CameraPose,
    ElevationModel,
    MeasuredSurface,
    PoseStd,
    Slope,
    image_setup,
    in_range,
    known_points,
    projection_model,
    with_stds_noted,
)
