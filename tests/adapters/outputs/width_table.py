"""An output of somebody else's: every value as a line of a text table."""

from pathlib import Path

from aerodft.adapters.config import Table
from aerodft.adapters.outputs import Run
from aerodft.adapters.wire.status import StationStatus
from aerodft.service import Batches, StepOutputs


class WidthTable(Table):
    file: str
    digits: int = 3


TABLE = "width_table"
MODEL = WidthTable
DEFAULT = None


def open_output(settings: WidthTable, run: Run) -> "WidthTableWriter":
    return WidthTableWriter(settings, run)


class WidthTableWriter:
    def __init__(self, settings: WidthTable, run: Run) -> None:
        self._settings = settings
        self._lines = [f"# {run.station}\n"]

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        del batches
        for _, _, batch in outputs.measured():
            for measurements in batch:
                for each in measurements:
                    self._lines.append(f"{each.stamp_ns},{each.name},{each.value:.{self._settings.digits}f}\n")

    def status(self, value: StationStatus) -> None:
        pass

    def warnings(self) -> tuple[str, ...]:
        return ()

    def close(self) -> None:
        Path(self._settings.file).write_text("".join(self._lines))
