"""What an output is, and what it may ask of the run that it is of."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from aerodft.adapters.config import Table
from aerodft.adapters.wire.requests import MeasureRequest
from aerodft.adapters.wire.status import StationStatus
from aerodft.model import Camera, Image, KnownPoint, Measurement, Observation, Probe
from aerodft.service import Sink


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run as its outputs see it.

    Attributes:
        station: Name of the station.
        camera: What its images are taken with.
        probes: What it measures.
        points: Surveyed points by name, which a question may name.
        is_live: Whether it measures as images come, not from files.
        measure: Measures at once what somebody asks for.
        put_observation: Takes what others have seen in the images, its arrival to be set; None where nobody may.
        in_utc: Puts an image's stamp into UTC.
    """

    station: str
    camera: Camera
    probes: tuple[Probe, ...]
    points: Mapping[str, KnownPoint]
    is_live: bool
    measure: Callable[[MeasureRequest], list[Measurement]]
    put_observation: Callable[[Observation], None] | None
    in_utc: Callable[[Image], Image]


class Output(Sink, Protocol):
    """An open output: takes what was read and measured, and the station's state."""

    def status(self, value: StationStatus) -> None:
        """Take the station's state, once a second of a live run."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Sentences on what failed; complete once the output is closed."""
        ...


class OutputKind(Protocol):
    """A kind of output: a module, or an object, that has these.

    To add one, write such a module and name it in ``registry.OUTPUTS``.
    """

    @property
    def TABLE(self) -> str:  # noqa: N802 - a module's constant
        """Name of the output's table in a station's configuration."""
        ...

    @property
    def MODEL(self) -> type[Table]:  # noqa: N802 - a module's constant
        """The table's pydantic model."""
        ...

    @property
    def DEFAULT(self) -> Table | None:  # noqa: N802 - a module's constant
        """The settings of a station without the table; None for no output."""
        ...

    def open_output(self, settings: Any, run: Run) -> Output | None:  # noqa: ANN401 - a MODEL
        """Open the output of a run; None where it has none of this kind.

        Raises:
            AerodftError: It cannot be opened.
        """
        ...
