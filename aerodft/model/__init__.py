"""Frozen values in SI units and radians, without I/O."""

from aerodft.model.arrays import BoolArray, FloatArray, FloatLike, ImageArray, IntArray, read_only
from aerodft.model.calibration import (
    BIASES,
    FIXED_POINTS,
    BiasValues,
    Calibration,
    CalibrationEstimate,
    CameraMotionEstimate,
    Innovation,
    MotionState,
)
from aerodft.model.camera import Camera, CameraMode, CameraStd, LensModel, Zoom, ZoomSource
from aerodft.model.evidence import (
    Evidence,
    EvidenceSet,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    MarkerSighting,
    MarkerSurvey,
    Prior,
    Px,
    SlantRange,
    SurveyedLandmark,
    SurveyedMarker,
    Vertical,
    marker_name,
)
from aerodft.model.health import (
    FIX_3D,
    RATIOS,
    EstimatorTrack,
    GimbalFailureTrack,
    GpsTrack,
    Health,
    HeartbeatTrack,
    LinkTrack,
    OtherSenderTrack,
)
from aerodft.model.image import Image, ImageRows, StampClock, VideoPacket, concatenate_images, image_indices
from aerodft.model.measurement import Ellipse95, GeoPoint, Measurement, PixelSource, Probe, ProbeKind, ProjectionModel
from aerodft.model.observation import VISION, Arrival, Box, Event, Observation
from aerodft.model.pose import (
    HORIZONTAL,
    TIME,
    GeoOrigin,
    GimbalSource,
    HeightDifference,
    HeightSource,
    HeightSwitch,
    Pose,
    PoseBatch,
    PoseSample,
    PoseStd,
)
from aerodft.model.status import CODE_OF, CODES, Status
from aerodft.model.telemetry import (
    NO_BOOT_TIME,
    CameraTrack,
    ClockTrack,
    GimbalTrack,
    HeightTrack,
    MountAxes,
    PositionTrack,
    RawBlock,
    ReportFrame,
    SyncTrack,
    Track,
    VehicleTrack,
    WireProtocol,
    concatenate_tracks,
)
