"""The tables of a station's whole configuration file, with their defaults and checks."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera import KnownPointTable, PoseTable
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.origin import OriginTable
from aerodft.adapters.config.station.ground import GroundTable
from aerodft.adapters.config.station.image_tables import ImagesTable
from aerodft.adapters.config.station.live_tables import LiveCalibrationTable, LiveLandmarkTable, StationMarkersTable
from aerodft.adapters.config.station.observer_tables import CameraMotionTable, ObjectsTable, RiverTable
from aerodft.adapters.config.station.probe_tables import ProbeTable
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, FromFile, SiAttribute, Table
from aerodft.adapters.config.telemetry_tables import TelemetryTable
from aerodft.errors import Reason
from aerodft.model import (
    FIXED_POINTS,
    ProbeKind,
    ProjectionModel,
)
from aerodft.service import OBJECTS


class StationTable(Table):
    """Name of the station."""

    name: Annotated[keys.Slug, SiAttribute("station"), NOT_IN_CONFIG_ID]
    origin: OriginTable | None = None
    tick_ms: Annotated[int, Field(ge=1, le=1000)] = 50


class ObservationsTable(Table):
    """Source of observed pixels."""

    files: Annotated[keys.Many[keys.Text], NOT_IN_CONFIG_ID] = ()
    topic: Annotated[bool, NOT_IN_CONFIG_ID] = True
    time_offset_s: keys.TimeOffset = 0.0
    match_tolerance_s: keys.Duration = 0.02


class LimitsTable(Table):
    """Limits beyond which nothing is measured."""

    max_range_m: keys.Positive | None = None


class RecordTable(Table):
    """The recorder."""

    folder: Annotated[keys.Text, SiAttribute(into=Path, out=str)] = "recordings"
    image_hz: keys.NonNegative = 1.0
    video: bool = True
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 80
    segment_s: Annotated[float, Field(ge=1, le=86_400)] = 900.0
    segment_mb: Annotated[float, Field(ge=1, le=100_000)] = 2000.0


_TOPICS = SiAttribute(into=lambda said: (said,) if isinstance(said, str) else said, out=lambda topics: topics or None)


_ONE_TOPIC = SiAttribute(into=lambda said: (said,) if said else (), out=lambda topics: topics[0] if topics else None)


class TopicsTable(Table):
    """Which topic is what in another tool's recording, where its channels do not tell."""

    mavlink: Annotated[keys.Many[keys.Text] | keys.Text, _TOPICS] = ()
    images: Annotated[keys.Text | None, _ONE_TOPIC] = None
    camera: Annotated[keys.Text | None, _ONE_TOPIC] = None


class StationCameraTable(FromFile):
    """A station's camera, and how it projects."""

    model: Annotated[ProjectionModel, Field(strict=False)] = ProjectionModel.PINHOLE


_NOT_IN_THE_PAPER = {"ground": "level ground only"} | dict.fromkeys(
    ("landmark", "markers", "camera_motion", "objects", "river"), "no roll"
)
"""Tables that the equations of the paper have no place for, and what they know instead."""


class ConfigTable(Table):
    """A station's whole file."""

    station: StationTable
    camera: StationCameraTable
    telemetry: TelemetryTable | None = None
    pose: Annotated[PoseTable | None, SiAttribute("fixed_pose")] = None
    ground: GroundTable | None = None
    images: ImagesTable = ImagesTable()
    observations: ObservationsTable = ObservationsTable()
    limits: LimitsTable = LimitsTable()
    record: Annotated[RecordTable, NOT_IN_CONFIG_ID] = RecordTable()
    topics: Annotated[TopicsTable, NOT_IN_CONFIG_ID] = TopicsTable()
    probe: Annotated[keys.Many[ProbeTable], SiAttribute("probes")] = ()
    known_point: Annotated[keys.Many[KnownPointTable], NOT_IN_CONFIG_ID] = ()
    landmark: keys.Many[LiveLandmarkTable] = ()
    live_calibration: Annotated[LiveCalibrationTable, SiAttribute("live")] = LiveCalibrationTable()
    markers: StationMarkersTable | None = None
    camera_motion: CameraMotionTable | None = None
    objects: ObjectsTable | None = None
    river: Annotated[RiverTable | None, NOT_IN_CONFIG_ID] = None

    @model_validator(mode="after")
    def _telemetry_or_pose(self) -> Self:
        if (self.telemetry is None) == (self.pose is None):
            got = "neither of them" if self.pose is None else "both of them"
            raise impossible("", got=got, expected="either [telemetry] or [pose]", hint="[pose] is for a fixed camera")
        if self.camera_motion is not None and self.pose is None:
            hint = "a camera that moves has no image to be held against"
            raise impossible("camera_motion", got=Reason("it stands beside [telemetry]"), expected="[pose]", hint=hint)
        if self.pose is not None and (tracked := next((each.name for each in self.probe if each.tracked), None)):
            got, hint = (
                f'tracked = true of "{tracked}" beside [pose]',
                "a fixed camera's pixels stay, or follow its turns with [camera_motion]",
            )
            raise impossible("probe", got=got, expected="[telemetry]", hint=hint)
        for key in ("landmark", "markers"):
            if getattr(self, key) and self.telemetry is None:
                hint = "find a fixed camera's pose with aerodft calibrate"
                raise impossible(key, got=Reason("it stands beside [pose]"), expected="[telemetry]", hint=hint)
        return self

    @model_validator(mode="after")
    def _suits_the_model(self) -> Self:
        stated = (key for key in _NOT_IN_THE_PAPER if getattr(self, key))
        if self.camera.model is ProjectionModel.DFT and (key := next(stated, None)):
            expected = f'"pinhole", or no {"[[landmark]]" if key == "landmark" else f"[{key}]"}'
            hint = f"the equations of the paper know {_NOT_IN_THE_PAPER[key]}"
            raise impossible(key, got=Reason('it stands beside camera.model = "dft"'), expected=expected, hint=hint)
        return self

    @model_validator(mode="after")
    def _suits_the_probes(self) -> Self:
        for name in (each.name for each in self.probe):
            if self.camera_motion is not None and name == FIXED_POINTS:
                expected = "another name: the points that stand still have this one"
                raise impossible("probe.name", got=f'"{name}", beside [camera_motion]', expected=expected)
            if self.objects is not None and (name == OBJECTS or name.startswith("object-")):
                expected = "another name: objects that move have such names"
                raise impossible("probe.name", got=f'"{name}", beside [objects]', expected=expected)
        if self.river is not None and not any(each.kind == ProbeKind.RIVER and each.observed for each in self.probe):
            expected = 'a [[probe]] with kind = "river" and observed = true'
            raise impossible("river", got="no probe that is measured from banks", expected=expected)
        return self
