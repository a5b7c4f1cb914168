"""Standard deviations of a pose, by its height, position and angles."""

from dataclasses import asdict, replace
from typing import Annotated, TypeVar

from pydantic import Field

from aerodft.adapters.config import keys
from aerodft.adapters.config.tables import SiAttribute, Table, si_value
from aerodft.model import PoseStd
from aerodft.service import ErrorStd

AngleStd = Annotated[float, Field(ge=0, le=180)]
StdsT = TypeVar("StdsT", PoseStd, ErrorStd)


class StdTable(Table):
    """Standard deviations; a default applies to what is left out."""

    height_m: Annotated[keys.NonNegative | None, SiAttribute("height_agl_m")] = None
    horizontal_m: keys.NonNegative | None = None
    tilt_deg: AngleStd | None = None
    pan_deg: AngleStd | None = None
    roll_deg: AngleStd | None = None
    heading_deg: AngleStd | None = None


def stds_from(table: StdTable, default: StdsT) -> StdsT:
    """The standard deviations that a validated table describes; ``default`` applies to what it leaves out."""
    stated = asdict(si_value(ErrorStd, table))
    return replace(default, **{name: std for name, std in stated.items() if std is not None})
