"""The measurement pipeline and its inputs, behind ports; without wire formats, files or wall clock."""

from aerodft.service.batches import ArrivalLimiter, Batches, first_arrival_ns
from aerodft.service.feed import Inbox, LiveFeed, MergedFeed, block_of
from aerodft.service.gimbal_sources import GIMBAL_SOURCES, GimbalReports, is_own_statement, reported_sources
from aerodft.service.height_sources import HEIGHT_SOURCES, HeightReader, HeightSettings
from aerodft.service.observers import LiveObservers, ObservedImages, ObserverCounts, ObserverSchedule
from aerodft.service.pipeline import Counts, Pipeline
from aerodft.service.ports import (
    Calibrator,
    Clock,
    Feed,
    ImageObserver,
    ImageOutputs,
    LandmarkObserver,
    ObjectTracker,
    Sink,
    Source,
    StepOutputs,
    TelemetryDecoder,
)
from aerodft.service.settings import (
    DEMAND_TILT_STD_RAD,
    DRIFT,
    OBJECTS,
    RADIO_STATUS,
    AngleScale,
    AttitudeSettings,
    CameraMotionSettings,
    ErrorStd,
    FixedMount,
    HealthSettings,
    LiveCalibration,
    ObjectSettings,
    PipelineSettings,
    RiverSettings,
    SigningSettings,
    TelemetrySettings,
    WaterHints,
    ZoomSettings,
)
from aerodft.service.streams import LAST, brackets
from aerodft.service.work import fixed_requests, locate_observation
