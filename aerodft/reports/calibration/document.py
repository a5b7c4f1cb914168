"""A calibration in words, tables and JSON."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, takes_degrees
from aerodft.cli.output import tables
from aerodft.errors import AerodftError, NoAnswerError
from aerodft.version import SOFTWARE
from calibration.flight import ImagesResult
from calibration.pose import LIMIT, ObservationResidual, Result, State, correlations, said

_SUSPICIOUS_P = 1e-4
_MOST_DECIMALS = 6
_LINE, _NARROW = 3, 0.01  # landmarks that make one, and how narrow it is for its length
_MOST_SCALED = 30.0  # of residuals, in stated stds; beyond that no scaling makes them true
_MOST_OUTLIERS = 0.4  # of all observations; beyond that nobody can tell who is right


def refusal(result: Result, found: EvidenceFile) -> NoAnswerError | None:
    """Why there is no calibration; None where there is one.

    Args:
        result: The calibration.
        found: The file of evidence, for the sentence.
    """
    why_not = _why_not(result, found.frame)
    return NoAnswerError("no calibration", where=found.path, got=why_not) if why_not else None


def _why_not(result: Result, frame: LocalFrame) -> str:
    solution, names = result.solution, result.problem.unknowns.names
    if result.weakest.std_share > LIMIT * solution.scaled:
        return f"{result.weakest.sentence}{_in_line(result)}"
    if contradiction := _contradiction(result):
        return contradiction
    if solution.rival is not None:
        other = ", ".join(f"{key} {value:.4g}" for key, value in values_of(solution.rival, names, frame).items())
        return (
            f"the observations fit another camera as well ({other}): add a landmark, or what you know of the camera"
            " under [camera]"
        )
    return _disagreement(result)


def images_refusal(result: ImagesResult, path: Path) -> NoAnswerError | None:
    """As :func:`refusal`, for many images."""
    why_not = _contradiction(result) or _disagreement(result)
    if result.weakest.std_share > LIMIT * result.solution.scaled:
        why_not = result.weakest.sentence
    return NoAnswerError("no calibration", where=path, got=why_not) if why_not else None


def _contradiction(result: Result | ImagesResult) -> str:
    """Residuals that no scaling makes true, or that make too little of what would be determined; else empty."""
    scaled = result.solution.scaled
    if result.weakest.is_determined and scaled <= _MOST_SCALED:
        return ""
    return (
        f"the observations contradict each other: residuals are {scaled:.0f} times as large as the stated"
        " stds; check the coordinates, the pixels and the stds"
    )


def _disagreement(result: Result | ImagesResult) -> str:
    """Too many observations that were left out; else empty."""
    kept = result.solution.kept
    if np.count_nonzero(~kept) <= _MOST_OUTLIERS * len(kept):
        return ""
    return (
        f"{np.count_nonzero(~kept)} of {len(kept)} observations disagree with the rest: check"
        " what is unknown (heading, position), the camera file, the coordinates and their stds"
    )


def _in_line(result: Result) -> str:
    """What to say of landmarks that are all in one line; empty where they are not."""
    places_m, _ = result.problem.landmarks
    if len(places_m) < _LINE:
        return ""
    along, across, *_ = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return "; all landmarks lie in one line: add one beside it" if across <= _NARROW * along else ""


def sentences(result: Result, found: EvidenceFile) -> list[str]:
    """What a person should know of the result."""
    guesses = sorted(found.fixed & set(result.problem.unknowns.names))
    keys = ", ".join(said(name)[0] for name in guesses)
    first = [f"{keys} has no std in the file: taken as a first guess only"] if guesses else []
    return [*found.notes, *fit_sentences(result), *first]


def fit_sentences(result: Result | ImagesResult) -> list[str]:
    """What was left out, and whether the stated stds are true."""
    solution, said_so = result.solution, []
    for left in result.left:
        if left.is_outlier:
            off = f"by {left.px:.0f} px" if math.isfinite(left.px) else "altogether: it cannot be seen from there"
            said_so.append(f"{left.name} disagrees {off}, left out")
    if solution.dof == 0:
        said_so.append("there is no observation to spare: a wrong one would not be noticed, add one")
    if solution.scaled > 1.0:
        said_so.append(
            f"the residuals are {solution.scaled:.1f} times as large as the stated stds: all stds are scaled up by that"
        )
    elif solution.p_value is not None and solution.p_value > 1 - _SUSPICIOUS_P:
        said_so.append("the residuals are much smaller than the stated stds: these may be too large")
    return said_so


def document(result: Result, found: EvidenceFile, error: AerodftError | None) -> dict[str, Any]:
    """The whole result as JSON; nothing that is not finite."""
    solution, names, frame = result.solution, result.problem.unknowns.names, found.frame
    place = frame.wgs84(solution.state.position_m)
    scales = [said(name)[1] for name in names]
    about = result_document(result, values_of(solution.state, names, frame), scales, error)
    about["observability"]["rival"] = None if solution.rival is None else values_of(solution.rival, names, frame)
    return {
        **about,
        "origin": list(frame.origin),
        "position": frame.file_coordinates(solution.state.position_m).tolist(),
        "lat_deg": None if place is None else math.degrees(place[0]),
        "lon_deg": None if place is None else math.degrees(place[1]),
        "crs": frame.crs,
        "model": str(solution.state.model),
        "notes": sentences(result, found),
    }


def result_document(
    result: Result | ImagesResult, values: dict[str, float], scales: Sequence[float], error: AerodftError | None
) -> dict[str, Any]:
    """What a calibration of one image or of many found, and how well it fits, as JSON.

    Args:
        result: The calibration.
        values: Of its unknowns, by the names that people see.
        scales: From SI to the units of these.
        error: Why there is none.
    """
    covariance = result.named_covariance * np.outer(scales, scales)
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    return {
        "schema": "aerodft.calibration/1",
        "status": "ok" if error is None else "ILL_CONDITIONED",
        "reasons": [] if error is None else [error.got if isinstance(error, NoAnswerError) else str(error)],
        "parameters": {
            key: {"value": value, "std": finite(std)} for (key, value), std in zip(values.items(), stds, strict=True)
        },
        "order": list(values),
        "covariance": rows(covariance),
        "correlations": rows(correlations(covariance)),
        **fit_document(result),
        "observability": {
            "determined": result.weakest.is_determined,
            "weakest": result.weakest.combination,
            "std_share": finite(result.weakest.std_share),
            "sentence": result.weakest.sentence,
            "rival": None,
        },
    }


def provenance(
    result: Result | ImagesResult, found: EvidenceFile, names: Sequence[str], inputs: dict[str, Any]
) -> dict[str, Any]:
    """What a calibration's file says of where it comes from.

    Args:
        result: The calibration.
        found: What it is from.
        names: What was asked for.
        inputs: What else it is from.
    """
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": SOFTWARE,
        "observations": found.path.name,
        "observations_sha256": found.sha256,
        **inputs,
        "unknowns": list(names),
        "rms_px": result.rms_px,
        "chi2": result.solution.chi2,
        "degrees_of_freedom": result.solution.dof,
        "outliers": [left.name for left in result.left if left.is_outlier],
    }


def fit_document(result: Result | ImagesResult) -> dict[str, Any]:
    """How well it fits, and what is left of each observation."""
    solution = result.solution
    return {
        "rms_px": result.rms_px,
        "chi2": solution.chi2,
        "degrees_of_freedom": solution.dof,
        "p_value": solution.p_value,
        "stds_scaled_by": solution.scaled,
        "residuals": [
            {
                "name": left.name,
                "px": finite(left.px),
                "sigma": finite(left.sigma),
                "ground_m": left.ground_m,
                "left_out_ground_m": left.left_out_ground_m,
                "outlier": left.is_outlier,
            }
            for left in result.left
        ],
        "outliers": [left.name for left in result.left if left.is_outlier],
    }


def print_result(result: Result, found: EvidenceFile) -> None:
    """Two tables: the unknowns, and what is left of each observation."""
    solution, names, frame = result.solution, result.problem.unknowns.names, found.frame
    table = Table("unknown", "value", "std")
    stds = np.sqrt(np.maximum(np.diag(result.named_covariance), 0.0))
    for (key, value), name, std in zip(values_of(solution.state, names, frame).items(), names, stds, strict=True):
        scaled = std * said(name)[1]
        table.add_row(key, f"{value:.{decimals(scaled)}f}", f"{scaled:.3g}")
    tables().print(table)
    tables().print(residual_table(result.left))
    rms = "" if result.rms_px is None else f"rms {result.rms_px:.2f} px, "
    place = ", ".join(f"{value:.3f}" for value in frame.file_coordinates(solution.state.position_m))
    fit = f"{rms}chi-square {solution.chi2:.1f} with {solution.dof} degrees of freedom"
    tables().print(f"{fit}; camera at {place} ({frame.crs})")
    if {"east", "north"} & set(names) and takes_degrees(frame.crs):
        origin = ", ".join(f"{value:.10g}" for value in frame.origin[:2])
        tables().print(f"east_m and north_m count from {origin}")


def decimals(std: float) -> int:
    """Places after the point that a value with this std deserves: those of the std's two leading digits."""
    if not 0 < std < math.inf:
        return _MOST_DECIMALS
    return max(0, 1 - math.floor(math.log10(std)))


def residual_table(leftovers: tuple[ObservationResidual, ...]) -> Table:
    """What is left of each observation."""
    rest = Table("observation", "px", "sigma", "on the ground (m)", "not having seen it (m)")
    for left in leftovers:
        ground, without = ("" if value is None else f"{value:.3f}" for value in (left.ground_m, left.left_out_ground_m))
        name = f"{left.name} (left out)" if left.is_outlier else left.name
        rest.add_row(name, f"{left.px:.2f}", f"{left.sigma:.2f}", ground, without)
    return rest


def values_of(state: State, names: Sequence[str], frame: LocalFrame) -> dict[str, float]:
    """A camera's values by the names that people see, in the order of the unknowns.

    Heights are above the ground; east, north and the ground's elevation are in the file's coordinates, but where these
    are degrees east and north count from the frame's origin.
    """
    places_m = dict(zip(("east", "north"), frame.file_coordinates(state.position_m).tolist(), strict=False))
    own = {"height": state.value("height") - state.elevation_m, "elevation": state.elevation_m + frame.origin[2]}
    own |= {} if takes_degrees(frame.crs) else places_m
    return {said(name)[0]: said(name)[1] * own.get(name, state.value(name)) for name in names}


def finite(value: float) -> float | None:
    """The value where there is one."""
    return value if math.isfinite(value) else None


def rows(matrix: np.ndarray) -> list[list[float | None]]:
    """A matrix for JSON; None for what is not finite."""
    return [[finite(value) for value in row] for row in matrix.tolist()]
