"""Measuring in one image: camera, pose, ground and probes to measurements."""

from aerodft.app.measure.measurements import (
    PROBES,
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
    requests_of,
)
from aerodft.app.measure.recorded_pose import Overrides, RecordedScenes, recorded_setup
from aerodft.app.measure.scene import (
    CameraPose,
    ElevationModel,
    MeasuredSurface,
    PoseStd,
    Slope,
    image_setup,
    with_pixels_noted,
)
