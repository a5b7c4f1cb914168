"""The paper's tables and figures as one JSON document: degrees and percent, as people read them."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from aerodft.cli.paper_notes import figure_12_notes, figure_14_notes, table_1_notes, table_2_notes, table_3_notes
from aerodft.dft.paper_sensitivity import Percent, Sensitivity, SensitivityRow
from aerodft.dft.paper_tables import CameraRow, DepthRow, ErrorCurve

SCHEMA: Final = "aerodft.paper/1"

_DEPTHS_M: Final = tuple(range(10, 151, 10))


def paper_document(
    cameras: Sequence[CameraRow],
    depths: Sequence[DepthRow],
    sensitivities: Sequence[SensitivityRow],
    curves: Sequence[ErrorCurve],
    canon: ErrorCurve,
    pngs: tuple[Path, Path],
) -> dict[str, Any]:
    """Everything that the command says, with what the paper prints beside what is computed."""
    return {
        "schema": SCHEMA,
        "table1": {"rows": [_camera(row) for row in cameras], "notes": table_1_notes(cameras)},
        "table2": {"rows": [_depth(row) for row in depths], "notes": table_2_notes(depths)},
        "table3": {"rows": [_sensitivity(row) for row in sensitivities], "notes": table_3_notes(sensitivities)},
        "figure12": {
            "png": str(pngs[0]),
            "curves": [_curve(curve) for curve in curves],
            "notes": figure_12_notes(curves),
        },
        "figure14": {
            "png": str(pngs[1]),
            "curves": [_curve(canon)],
            "points": [_point(row) for row in depths],
            "notes": figure_14_notes(depths),
        },
    }


def _camera(row: CameraRow) -> dict[str, Any]:
    camera, text = row.printed.camera, row.printed.text_error_m
    return {
        "label": row.printed.label,
        "camera": camera.name,
        "size_px": [camera.width_px, camera.height_px],
        "fov_deg": [round(math.degrees(camera.hfov_rad), 6), round(math.degrees(camera.vfov_rad), 6)],
        "printed_pitch_deg": round(math.degrees(row.printed.tilt_rad), 6),
        "pitch_for_z_150_deg": math.degrees(row.tilt_for_depth_rad),
        "pitch_for_y_150_deg": math.degrees(row.tilt_for_ahead_rad),
        "depth_at_printed_pitch_m": row.depth_at_printed_m,
        "corner_depth_at_printed_pitch_m": row.corner_at_printed_m,
        "text_error_at_150_m": None if text is None else list(text),
        "error_at_150_m": row.error_m,
        "error_at_150_with_row_above_m": row.error_outward_m,
        "depth_of_text_error_m": row.depth_of_text_error_m,
    }


def _depth(row: DepthRow) -> dict[str, Any]:
    printed = row.printed
    return {
        "case": printed.case,
        "truth_m": printed.truth_m,
        "printed_depth_m": printed.depth_m,
        "printed_error_m": printed.error_m,
        "printed_error_percent": printed.error_percent,
        "psi_deg": math.degrees(row.psi_rad),
        "psi_at_border_deg": math.degrees(row.psi_at_border_rad),
        "row_px": row.row_px,
        "row_half_digit_px": row.row_half_digit_px,
        "depth_at_whole_row_m": row.depth_m,
        "error_m": row.error_m,
        "error_percent": row.error_percent,
        "quantization_m": row.quantization_m,
        "error_px": row.error_m / row.quantization_m,
        "pitch_error_deg": math.degrees(row.tilt_error_rad),
        "pinhole_depth_m": row.pinhole_m,
    }


def _sensitivity(row: SensitivityRow) -> dict[str, Any]:
    printed = row.printed
    return {
        "input": printed.input,
        "error": printed.error,
        "delta_psi_deg": math.degrees(printed.delta_psi_rad),
        "delta_phi_deg": math.degrees(printed.delta_phi_rad),
        "delta_height_percent": 100 * printed.delta_height,
        "printed_percent": _xyz(printed.percent),
        "holds_at": _direction(row.holds_at),
        "displacement_percent": row.displacement_percent,
        "true": [_direction(true) for true in row.true],
    }


def _direction(at: Sensitivity) -> dict[str, Any]:
    return {
        "psi_deg": round(math.degrees(at.psi_rad), 6),
        "phi_deg": round(math.degrees(at.phi_rad), 6),
        "derivative_percent": _xyz(at.derivative_percent),
        "change_percent": _xyz(at.change_percent),
    }


def _xyz(percent: Percent) -> dict[str, float]:
    return dict(zip("XYZ", percent, strict=True))


def _curve(curve: ErrorCurve) -> dict[str, Any]:
    return {"label": curve.label, "depth_m": list(_DEPTHS_M), "error_m": [curve.at(depth) for depth in _DEPTHS_M]}


def _point(row: DepthRow) -> dict[str, float]:
    return {"truth_m": row.printed.truth_m, "error_m": row.printed.error_m, "quantization_m": row.quantization_m}
