"""The table ``[images]``: where a station's images come from."""

from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.station.station_config import (
    Device,
    ImageInput,
    ImageSettings,
    Rate,
    Stills,
    StreamInput,
    VideoFile,
)
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, UNLESS_ZERO, SiAttribute, Table, si_value
from aerodft.adapters.timestamps import parse_offset
from aerodft.errors import Reason


def _seconds_or_auto(value: object) -> object:
    """A number as it is; None for ``auto``."""
    if value == "auto":
        return None
    if isinstance(value, str):
        raise impossible("", got=f'"{value}"', expected='a number of seconds, or "auto"')
    return value


def _offset(value: str) -> str:
    try:
        parse_offset(value)
    except ValueError:
        raise impossible("", got=f'"{value}"', expected='an offset from UTC like "+02:00"') from None
    return value


def _as_stated(seconds: object) -> object:
    return seconds


SecondsOrAuto = Annotated[keys.TimeOffset | None, BeforeValidator(_seconds_or_auto), PlainSerializer(_as_stated)]


Url = Annotated[str, keys.matching(r"[a-z0-9+]+:\S+", 'a URL like "udp://0.0.0.0:5600"')]


_INPUTS: Final[dict[str, tuple[type[ImageInput], str]]] = {
    "video": (VideoFile, "path"),
    "stills": (Stills, "folder"),
    "stream": (StreamInput, "url"),
    "device": (Device, "path"),
    "rate_hz": (Rate, "rate_hz"),
}
"""What the images' five inputs are: the class, and which of its attributes has the key's value."""


class ImagesTable(Table):
    """Source of images; at most one of the five inputs."""

    video: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    start: Annotated[keys.Instant | None, SiAttribute("start_ns"), NOT_IN_CONFIG_ID] = None
    stills: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    pattern: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    utc_offset: Annotated[Annotated[str, AfterValidator(_offset)] | None, NOT_IN_CONFIG_ID] = None
    stream: Annotated[Url | None, NOT_IN_CONFIG_ID] = None
    device: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None
    rate_hz: Annotated[Annotated[float, Field(gt=0, le=1000)] | None, NOT_IN_CONFIG_ID] = None
    time_offset_s: SecondsOrAuto = 0.0
    time_drift: Annotated[float, Field(ge=-0.5, le=0.5), UNLESS_ZERO] = 0.0
    time_reference: Annotated[keys.Instant | None, SiAttribute("time_reference_ns")] = None
    time_std_s: keys.Duration = 0.0

    @model_validator(mode="after")
    def _one_input(self) -> Self:
        inputs = [key for key in _INPUTS if getattr(self, key) is not None]
        if len(inputs) > 1:
            raise impossible(
                inputs[1], got=Reason(f"it stands beside {inputs[0]}"), expected=f"one of {', '.join(_INPUTS)}"
            )
        for key, owner in (("start", "video"), ("pattern", "stills"), ("utc_offset", "stills")):
            if getattr(self, key) is not None and getattr(self, owner) is None:
                raise impossible(key, got=Reason(f"it stands without {owner}"), expected=f"{owner} beside it")
        if self.time_drift and self.time_reference is None:
            expected = "time_reference beside it, the instant of the camera's clock at which time_offset_s holds"
            raise impossible("time_drift", got=Reason("it stands without time_reference"), expected=expected)
        if self.time_offset_s is None and (self.time_drift or self.time_reference is not None):
            raise impossible("time_offset_s", got='"auto" beside a drift', expected="a number, or no drift")
        return self


def images_from(table: ImagesTable, folder: Path) -> ImageSettings:
    """Image settings of the tables; relative paths start from ``folder``."""
    offset_s = table.time_offset_s
    source: ImageInput | None = None
    key = next((key for key in _INPUTS if getattr(table, key) is not None), None)
    if key is not None:
        kind, attribute = _INPUTS[key]
        stated = getattr(table, key)
        source = si_value(kind, table, **{attribute: folder / stated if key in ("video", "stills") else stated})
    return si_value(ImageSettings, table, source=source, time_offset_s=offset_s or 0.0, is_auto=offset_s is None)


def images_table(settings: ImageSettings, time_std_s: float) -> ImagesTable:
    """The table of where images come from, and of their stamps' std; reading it gives equal settings."""
    stated: dict[str, object] = {"time_offset_s": "auto"} if settings.is_auto else {}
    for key, (kind, attribute) in _INPUTS.items():
        if isinstance(settings.source, kind):
            value = getattr(settings.source, attribute)
            stated[key] = str(value.absolute()) if isinstance(value, Path) else value
    return ImagesTable.from_si(settings, settings.source, time_std_s=time_std_s, **stated)
