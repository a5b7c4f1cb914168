"""A calibration as a JSON document, with what a person should know of it in sentences."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, takes_degrees
from aerodft.errors import AerodftError, NoAnswerError
from aerodft.model import FloatArray, Landmark
from calibration.flight import ImagesResult
from calibration.pose import ObservationResidual, Result, State, angles_deg, correlations, display_unit

_UNLIKELY_P = 0.01
_NOTICED = 1.2  # of what stds are multiplied with
_SUSPICIOUS_P = 1e-4
_MAX_DECIMALS = 6


def calibration_notes(result: Result | ImagesResult, evidence: EvidenceFile) -> list[str]:
    """What a person should know: doubts about images, rejected observations, and whether the stated stds are true."""
    solution, notes = result.solution, list(evidence.notes)
    for each, left in zip(result.evidence, result.left, strict=True):
        if math.isfinite(left.px):
            where = f"it is {left.px:.0f} px from where the estimated camera would see it"
        elif isinstance(each, Landmark):
            where = "it lies behind the estimated camera"
        else:
            where = "the estimated camera does not see the ground there"
        if left.is_outlier:
            notes.append(f"Rejected {left.name}: {where}.")
    if solution.dof == 0:
        notes.append("there is no observation to spare: a wrong one would not be noticed, add one")
    spare = f"{solution.dof} numbers to spare" if solution.dof != 1 else "1 number to spare"
    if solution.p_value is not None and solution.p_value < _UNLIKELY_P:
        notes.append(
            f"the residuals are {solution.misfit:.3g} times as large as the stated stds ({spare}): all stds are"
            f" multiplied by {solution.sigma_scale:.3g}"
        )
    elif solution.sigma_scale > _NOTICED:
        notes.append(
            f"all stds are multiplied by {solution.sigma_scale:.2g}: {spare} tell little of whether the stated ones are"
            " true"
        )
    elif solution.p_value is not None and solution.p_value > 1 - _SUSPICIOUS_P:
        notes.append("the residuals are much smaller than the stated stds: these may be too large")
    if isinstance(result, Result) and (guesses := sorted(evidence.fixed & set(result.names))):
        keys = ", ".join(display_unit(name)[0] for name in guesses)
        notes.append(f"{keys} has no std in the file: taken as a first guess only")
    return notes


def calibration_document(
    result: Result | ImagesResult, evidence: EvidenceFile, error: AerodftError | None
) -> dict[str, Any]:
    """The whole result as JSON; nothing that is not finite.

    Args:
        result: The calibration.
        evidence: The file that it is from.
        error: Why it is refused; None where it holds.
    """
    frame, solution = evidence.frame, result.solution
    covariance, stds = displayed_covariance(result)
    fitted: dict[str, Any] = {
        "schema": "aerodft.calibration/1",
        "status": "ok" if error is None else "ILL_CONDITIONED",
        "reasons": [] if error is None else [error.got if isinstance(error, NoAnswerError) else str(error)],
        "parameters": {
            key: {"value": value, "std": _finite(std)}
            for (key, value), std in zip(displayed_values(result, frame).items(), stds.tolist(), strict=True)
        },
        "order": list(result.display_units),
        "covariance": _rows(covariance),
        "correlations": _rows(correlations(covariance)),
        "rms_px": result.rms_px,
        "chi2": solution.chi2,
        "degrees_of_freedom": solution.dof,
        "p_value": solution.p_value,
        "misfit": solution.misfit,
        "sigma_scale": solution.sigma_scale,
        "residuals": list(map(_residual, result.left)),
        "outliers": [left.name for left in result.left if left.is_outlier],
        "observability": _observability(result, frame),
    }
    if isinstance(result, ImagesResult):
        fitted["images"] = _images(result, frame)
        position, place, model = None, None, result.solution.state.base.model
    else:
        state = result.solution.state
        fitted["origin"] = list(frame.origin)
        position, place, model = (
            frame.file_coordinates(state.position_m).tolist(),
            frame.wgs84(state.position_m),
            state.model,
        )
    return {
        **fitted,
        "position": position,
        "lat_deg": None if place is None else math.degrees(place[0]),
        "lon_deg": None if place is None else math.degrees(place[1]),
        "crs": frame.crs,
        "model": str(model),
        "notes": calibration_notes(result, evidence),
    }


def _residual(left: ObservationResidual) -> dict[str, Any]:
    return {
        "name": left.name,
        "px": _finite(left.px),
        "sigma": _finite(left.sigma),
        "ground_m": left.ground_m,
        "loo_ground_m": left.loo_ground_m,
        "outlier": left.is_outlier,
    }


def _observability(result: Result | ImagesResult, frame: LocalFrame) -> dict[str, Any]:
    other = result.solution.alternative if isinstance(result, Result) else None
    return {
        "determined": result.weakest.is_determined,
        "weakest": result.weakest.combination,
        "std_share": _finite(result.weakest.std_share),
        "sentence": result.weakest.sentence,
        "rival": None if other is None else values_of(other, result.names, frame),
    }


def displayed_values(result: Result | ImagesResult, frame: LocalFrame) -> dict[str, float]:
    """What was found, by the names that people see (``tilt_deg``), in the order of the unknowns."""
    if isinstance(result, ImagesResult):
        return result.named_values
    return values_of(result.solution.state, result.names, frame)


def displayed_covariance(result: Result | ImagesResult) -> tuple[FloatArray, FloatArray]:
    """The covariance ``(n, n)`` and standard deviations ``(n,)`` of what was found, in the units that people see."""
    scales = list(result.display_units.values())
    covariance = result.named_covariance * np.outer(scales, scales)
    return covariance, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def values_of(state: State, names: Sequence[str], frame: LocalFrame) -> dict[str, float]:
    """A camera's values by the names that people see, in the order of the unknowns.

    Heights are above the ground; east, north and the ground's elevation are in the file's coordinates, but where these
    are degrees east and north count from the frame's origin.
    """
    places_m = dict(zip(("east", "north"), frame.file_coordinates(state.position_m).tolist(), strict=False))
    own = {"height": state.value("height") - state.elevation_m, "elevation": state.elevation_m + frame.origin[2]}
    own |= {} if takes_degrees(frame.crs) else places_m
    return {display_unit(name)[0]: display_unit(name)[1] * own.get(name, state.value(name)) for name in names}


def decimals(std: float) -> int:
    """Places after the point that a value with this std deserves: those of the std's two leading digits."""
    if not 0 < std < math.inf:
        return _MAX_DECIMALS
    return max(0, 1 - math.floor(math.log10(std)))


def _images(result: ImagesResult, frame: LocalFrame) -> list[dict[str, Any]]:
    """Where each image was taken, and how far that is from the corrected telemetry in its own standard deviations."""
    described = []
    for view, camera, own in zip(result.problem.views, result.solution.cameras, result.solution.state.own, strict=True):
        tilt_deg, roll_deg, heading_deg = angles_deg(camera)
        described.append(
            {
                "name": view.name,
                "height_agl_m": float(camera.position_m[2]) - camera.elevation_m,
                "tilt_deg": tilt_deg,
                "roll_deg": roll_deg,
                "heading_deg": heading_deg,
                "position": frame.file_coordinates(camera.position_m).tolist(),
                "from_telemetry_sigma": float(np.linalg.norm(own)),
            }
        )
    return described


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rows(matrix: FloatArray) -> list[list[float | None]]:
    return [[_finite(value) for value in row] for row in matrix.tolist()]
