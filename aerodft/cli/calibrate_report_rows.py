"""What a calibration's report says of each observation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerodft.cli.calibrate_report_marks import Mark, ground_of, mark_of
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Evidence, Landmark
from calibration.descent import Rows as Residuals
from calibration.errors_left import Leftover
from calibration.images_result import ImagesResult
from calibration.result import Result
from calibration.state import State


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One observation.

    Attributes:
        mark: In the image.
        left: What is left of it.
        values: ``(m,)`` its residuals in standard deviations, independent of each other.
        range_m: From the camera to what was observed, or to the ground that is seen there; NaN where it shows none.
    """

    mark: Mark
    left: Leftover
    values: FloatArray
    range_m: float

    @property
    def sigma(self) -> FloatArray:
        """``(2,)`` its residual in standard deviations, in the direction that it has in the image."""
        length = float(np.linalg.norm(self.mark.off_px))
        return self.mark.off_px * (self.left.sigma / length if length > 0 else 0.0)

    @property
    def is_plane(self) -> bool:
        """It says two things, right and down, not one."""
        return len(self.values) == 2  # noqa: PLR2004 - dimensions of an image


def rows_of(result: Result) -> tuple[Row, ...]:
    """All observations, in their order."""
    evidence, residuals = result.problem.known.evidence, result.solution.residuals
    states = (result.solution.state,) * len(evidence)
    return _rows(evidence, states, result.left, residuals)


def rows_of_images(result: ImagesResult) -> tuple[Row, ...]:
    """All observations of all images, one image after the other."""
    problem, solution = result.problem, result.solution
    states = tuple(solution.cameras[image] for image in problem.image_of)
    return _rows(problem.evidence, states, result.left, solution.residuals)


def _rows(
    evidence: Sequence[Evidence], states: Sequence[State], leftovers: Sequence[Leftover], residuals: Residuals
) -> tuple[Row, ...]:
    rows = []
    for index, (each, state, left) in enumerate(zip(evidence, states, leftovers, strict=True)):
        mark, values = mark_of(state, each), residuals.values[residuals.owner == index]
        rows.append(Row(mark, left, values, _range_m(state, each, mark)))
    return tuple(rows)


def _range_m(state: State, evidence: Evidence, mark: Mark) -> float:
    if isinstance(evidence, Landmark):
        east, north, up = evidence.position_m
        if east is not None and north is not None and up is not None:
            return math.dist((east, north, up), state.position_m.tolist())
    seen = ground_of(state, mark.seen_px, state.elevation_m)
    return float(np.linalg.norm(seen - state.position_m, axis=-1).mean())
