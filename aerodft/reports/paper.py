"""The paper's tables and figures: a JSON document with a sentence for every difference, and the figures as PNG."""

import math
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerodft.adapters.files import output_folder
from aerodft.dft import paper
from aerodft.reports.style import save_figure, styled

_SCHEMA: Final = "aerodft.paper/1"

_DEPTHS_M: Final = tuple(range(10, 151, 10))

_SIZE_IN = (8, 5)
_HALF_DIGIT: Final = 0.005
_HALF_PITCH_DIGIT_DEG: Final = 0.05


def reproduce_paper(folder: Path) -> dict[str, Any]:
    """Compute Tables 1 to 3, and draw Figures 12 and 14 into a folder, which is made where it is missing.

    Returns:
        All tables and figures as JSON values (``aerodft.paper/1``), with what the paper prints beside what is computed.

    Raises:
        InputError: The folder cannot be written to.
    """
    cameras, depths, sensitivities = paper.table_1(), paper.table_2(), paper.table_3()
    curves, canon = paper.figure_12(), paper.figure_14()
    pngs = folder / "figure-12.png", folder / "figure-14.png"
    with output_folder(folder, "the figures"):
        _draw_figure_12(curves, cameras, pngs[0])
        _draw_figure_14(canon, depths, pngs[1])
    return {
        "schema": _SCHEMA,
        "table1": {"rows": [_camera(row) for row in cameras], "notes": _table_1_notes(cameras)},
        "table2": {"rows": [_depth(row) for row in depths], "notes": _table_2_notes(depths)},
        "table3": {"rows": [_sensitivity(row) for row in sensitivities], "notes": _table_3_notes(sensitivities)},
        "figure12": {
            "png": str(pngs[0]),
            "curves": [_curve(curve) for curve in curves],
            "notes": _figure_12_notes(curves),
        },
        "figure14": {
            "png": str(pngs[1]),
            "curves": [_curve(canon)],
            "points": [_point(row) for row in depths],
            "notes": _figure_14_notes(depths),
        },
    }


def _camera(row: paper.CameraRow) -> dict[str, Any]:
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


def _depth(row: paper.DepthRow) -> dict[str, Any]:
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


def _sensitivity(row: paper.SensitivityRow) -> dict[str, Any]:
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


def _direction(at: paper.Sensitivity) -> dict[str, Any]:
    return {
        "psi_deg": round(math.degrees(at.psi_rad), 6),
        "phi_deg": round(math.degrees(at.phi_rad), 6),
        "derivative_percent": _xyz(at.derivative_percent),
        "change_percent": _xyz(at.change_percent),
    }


def _xyz(percent: paper.Percent) -> dict[str, float]:
    return dict(zip("XYZ", percent, strict=True))


def _curve(curve: paper.ErrorCurve) -> dict[str, Any]:
    return {"label": curve.label, "depth_m": list(_DEPTHS_M), "error_m": [curve.at(depth) for depth in _DEPTHS_M]}


def _point(row: paper.DepthRow) -> dict[str, float]:
    return {"truth_m": row.printed.truth_m, "error_m": row.printed.error_m, "quantization_m": row.quantization_m}


def _table_1_notes(rows: Sequence[paper.CameraRow]) -> list[str]:
    """Table 1: pitches, and the quantization errors that Section 5.1 states in its text."""
    by_label = {row.printed.label: row for row in rows}
    canon, nao = by_label["Cam1"], by_label["Cam7"]
    along, ahead = (
        _rounded(rows, lambda row: row.tilt_for_depth_rad),
        _rounded(rows, lambda row: row.tilt_for_ahead_rad),
    )
    neither = " and ".join(label for label in by_label if label not in {*along, *ahead})
    pitch = (
        "Pitch: the paper adjusts it until the greatest depth is 150 m. If that is the slant range Z of the top row's"
        f" middle, {len(along)} of {len(rows)} printed pitches are the computed ones to 0.1 deg ({', '.join(along)});"
        f" if it is the distance ahead, Y, {len(ahead)} are ({', '.join(ahead)}). {neither} fit neither: Cam7 is off by"
        f" {_off_deg(nao):.2f} deg, Cam1 by {_off_deg(canon):.2f} deg."
    )
    cam1 = (
        f"Cam1 needs {_deg(canon.tilt_for_depth_rad):.2f} deg: at the printed {_deg(canon.printed.tilt_rad):.1f} deg"
        f" the top row ends at {canon.depth_at_printed_m:.1f} m in its middle; only towards its corners"
        f" ({canon.corner_at_printed_m:.1f} m) does it reach 150 m."
    )
    return [pitch, cam1, *_text_error_notes(rows, by_label)]


def _text_error_notes(rows: Sequence[paper.CameraRow], by_label: dict[str, paper.CameraRow]) -> list[str]:
    sdz, snb, dlink, nao = (by_label[label] for label in ("Cam2", "Cam3", "Cam4", "Cam7"))
    nearer = ", ".join(_text_depth(row) for row in rows if row.printed.text_error_m)
    definition = (
        "Error at 150 m: by the definition in Section 5.1, the largest change of Z among the 8 neighbours (here: those"
        " inside the image), at the top row's middle. One more row above the image would make it a little larger (Cam4:"
        f" {dlink.error_outward_m:.2f} m). The text's figures fit the definition nearer to the camera, as if read off"
        f" the plot: {nearer}."
    )
    samsung = (
        "The text gives 2.0-2.5 m for the two Samsung cameras 'respectively', the SDZ first and so the smaller;"
        f" computed it is the larger, {sdz.error_m:.2f} m against {snb.error_m:.2f} m."
    )
    resolution = (
        "Section 5.1 says that Cam2 and Cam7 have the same resolution; by Table 1 it is Cam3 that has 640x480 as Cam7."
        f" Its conclusion holds for those two: {snb.error_m:.2f} m against {nao.error_m:.2f} m with the narrower view."
    )
    return [definition, samsung, resolution]


def _table_2_notes(rows: Sequence[paper.DepthRow]) -> list[str]:
    """Table 2: what had to be assumed, its arithmetic, and what its errors look like."""
    off = [str(row.printed.case) for row in rows if abs(row.error_m - row.printed.error_m) > _HALF_DIGIT]
    percent = max(abs(row.error_percent - row.printed.error_percent) for row in rows)
    arithmetic = (
        f"Arithmetic: truth - estimate is the printed error but for cases {' and '.join(off)}, which are 0.01 m off, as"
        f" two depths rounded to 0.01 m can be; the percentages agree within {percent:.3f} %."
    )
    pixels = [row.error_m / row.quantization_m for row in rows]
    tilts = [_deg(row.tilt_error_rad) for row in rows]
    one_sided = (
        f"All ten estimates are short, by {min(pixels):.0f} to {max(pixels):.0f} pixels: errors of picking, as Section"
        f" 5.2 has it, would fall on both sides. A pitch {min(tilts):.2f} to {max(tilts):.2f} deg above the printed"
        f" {_deg(paper.TABLE_2_TILT_RAD):.1f} deg (column 'pitch') makes each estimate meet its truth."
    )
    linear = max(abs(_deg(row.psi_rad - math.acos(paper.TABLE_2_HEIGHT_M / row.pinhole_m))) for row in rows)
    pinhole = (
        "Linear angles: a pinhole with the same field of view sees the same rows at other angles, by up to"
        f" {linear:.2f} deg; its depths stand in the column 'pinhole'."
    )
    return [*_recovery_notes(rows), arithmetic, one_sided, pinhole]


def _recovery_notes(rows: Sequence[paper.DepthRow]) -> list[str]:
    near, far = rows[0], rows[-1]
    recovered = (
        "The paper prints no pixels. psi is recovered from its estimated depth, psi = acos(h / Z) with"
        f" h = {paper.TABLE_2_HEIGHT_M} m, as if the point lay in the middle column (X = 0); the row follows from Eq. 3"
        f" with theta = {_deg(paper.TABLE_2_TILT_RAD):.1f} deg. At the image's left or right border psi would be"
        f" {_deg(near.psi_rad - near.psi_at_border_rad):.1f} (case 1) to"
        f" {_deg(far.psi_rad - far.psi_at_border_rad):.1f} deg (case 10) smaller."
    )
    between = sum(abs(row.row_px - round(row.row_px)) > row.row_half_digit_px for row in rows)
    theta_px = _HALF_PITCH_DIGIT_DEG / (_deg(paper.CANON.vfov_rad) / paper.CANON.height_px)
    digits = (
        f"Depths printed to 0.01 m fix the row to {near.row_half_digit_px:.2f} px (case 1) to"
        f" {far.row_half_digit_px:.2f} px (case 10); theta printed to 0.1 deg may shift all rows together by"
        f" {theta_px:.1f} px. {between} of {len(rows)} rows lie farther than the former from a whole row, and not all"
        " by the same: points beside the middle column, or picked between pixels. So the depth at the nearest whole row"
        " is not quite the printed one."
    )
    return [recovered, digits]


def _table_3_notes(rows: Sequence[paper.SensitivityRow]) -> list[str]:
    """Table 3: how each percentage arises, and where it holds."""
    pitch, height, x_axis, y_axis = rows
    angles = (
        f"Pitch and y-axis: X and Y are tan(1 deg) = {pitch.holds_at.change_percent[1]:.2f} % and tan(2 deg) ="
        f" {y_axis.holds_at.change_percent[1]:.2f} % of the camera height. That is the change of Y at psi = 0 alone"
        " (elsewhere it grows with 1 / cos^2 psi), and of X only if also phi = 45 deg, which no camera of Table 1 sees."
    )
    mixed = (
        "Camera height: 1 % of h in X and Y holds at psi = 45 deg alone (for X at phi = 45 deg too), not at psi = 0,"
        f" where it is 0. x-axis: {x_axis.holds_at.change_percent[0]:.2f} % = tan(2 deg) is the change of X at phi = 0"
        " in percent of Y, and so of the camera height at psi = 45 deg alone. The rows of one table hold at different"
        " angles."
    )
    bound = (
        "Column Z is the length of the vector of the other changes: sqrt(2) x 1.75 = 2.475 (printed 2.48; unrounded"
        f" {pitch.displacement_percent:.2f}), sqrt(3) x 1 = {height.displacement_percent:.2f} (the height itself"
        f" counted in), {x_axis.displacement_percent:.2f}, sqrt(2) x 3.49 = {y_axis.displacement_percent:.2f}. It is"
        " how far the ground point moves, an upper bound of the change of Z, which at those angles is"
        f" {', '.join(f'{row.holds_at.change_percent[2]:.2f}' for row in rows)} %."
    )
    return [angles, mixed, bound, *_size_notes(pitch)]


def _size_notes(pitch: paper.SensitivityRow) -> list[str]:
    across = [_deg(printed.camera.hfov_rad) / 100 for printed in paper.TABLE_1]
    up = [_deg(printed.camera.vfov_rad) / 100 for printed in paper.TABLE_1]
    worst = max(true.derivative_percent[1] for true in pitch.true)
    percent = (
        "1 % of the image is taken for 2.0 deg; with the fields of view of Table 1 it is"
        f" {min(across):.2f} to {max(across):.2f} deg across and {min(up):.2f} to {max(up):.2f} deg up. The true"
        " figures here keep the 2.0 deg, to be comparable."
    )
    not_a_maximum = (
        f"So these are no maximum errors: at psi = 85 deg one degree of pitch moves Y by {worst:.0f} % of the camera"
        " height, and there the whole change is larger than even the derivative says."
    )
    return [percent, not_a_maximum]


def _figure_12_notes(curves: Sequence[paper.ErrorCurve]) -> list[str]:
    """Figure 12: what is drawn."""
    nearest = [curve.depth_m.min() for curve in curves]
    return [
        (
            f"Middle column, 10.0 m high, at the pitch with which each camera reaches {paper.MAX_DEPTH_M:.0f} m. A"
            f" curve begins at the image's bottom row, {min(nearest):.1f} to {max(nearest):.1f} m away, and ends flat:"
            " the top row has no neighbour above it. Crosses and bars: what the text of Section 5.1 says."
        )
    ]


def _figure_14_notes(rows: Sequence[paper.DepthRow]) -> list[str]:
    """Figure 14: the text's figures beside the table's."""
    far = rows[-1]
    return [
        (
            f"Section 5.2 speaks of 3.6 m 'at a distance of 150 m' with a quantization error of 0.5 m; by Table 2 the"
            f" point is {far.printed.truth_m} m away, and the quantization error at its estimated depth is"
            f" {far.quantization_m:.2f} m. 0.5 m is reached at {paper.figure_14_text_depth():.0f} m."
        )
    ]


def _deg(angle_rad: float) -> float:
    return math.degrees(angle_rad)


def _off_deg(row: paper.CameraRow) -> float:
    return abs(_deg(row.tilt_for_depth_rad - row.printed.tilt_rad))


def _rounded(rows: Sequence[paper.CameraRow], tilt_rad: Callable[[paper.CameraRow], float]) -> list[str]:
    """Labels of the cameras whose printed pitch is the computed one, rounded as printed."""
    return [
        row.printed.label for row in rows if abs(_deg(tilt_rad(row) - row.printed.tilt_rad)) <= _HALF_PITCH_DIGIT_DEG
    ]


def _text_depth(row: paper.CameraRow) -> str:
    highest = (row.printed.text_error_m or (math.nan, math.nan))[1]
    if row.depth_of_text_error_m is None:
        return f"{row.printed.label} never has {highest} m"
    return f"{row.printed.label} has {highest} m at {row.depth_of_text_error_m:.0f} m"


@styled()
def _draw_figure_12(curves: Sequence[paper.ErrorCurve], cameras: Sequence[paper.CameraRow], path: Path) -> None:
    """Quantization error over depth, one curve a camera, and what the paper's text says of 150 m."""
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    axes = figure.subplots()
    styles = cycle(("-", "-", "-", "-", "--"))  # the fifth curve lies on the first
    for curve, row, style in zip(curves, cameras, styles, strict=False):
        (line,) = axes.plot(curve.depth_m, curve.error_m, style, label=curve.label)
        text = row.printed.text_error_m
        if text is not None:
            middle, half = (text[0] + text[1]) / 2, (text[1] - text[0]) / 2
            axes.errorbar(paper.MAX_DEPTH_M + 2, middle, yerr=half, fmt="x", capsize=4, color=line.get_color())
    axes.plot([], [], "kx", label="the paper's text, at 150 m")
    axes.set(xlim=(10, 155), ylim=(0, None), xlabel="depth Z (m)", ylabel="quantization error (m)")
    axes.set_title("Figure 12: quantization error, camera 10 m high")
    _save(figure, axes, path)


@styled()
def _draw_figure_14(curve: paper.ErrorCurve, rows: Sequence[paper.DepthRow], path: Path) -> None:
    """Errors of Table 2 and the Canon's quantization error over depth."""
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    axes = figure.subplots()
    axes.plot([row.printed.truth_m for row in rows], [row.printed.error_m for row in rows], "o-", label="Table 2")
    seen = curve.depth_m <= paper.MAX_DEPTH_M + 1
    axes.plot(curve.depth_m[seen], curve.error_m[seen], label="quantization error, computed")
    axes.plot(
        [paper.MAX_DEPTH_M],
        [paper.FIGURE_14_ERROR_M],
        "kx",
        label=f"the paper's text: {paper.FIGURE_14_ERROR_M} m at 150 m",
    )
    axes.set(xlim=(10, 155), ylim=(0, None), xlabel="depth Z (m)", ylabel="error (m)")
    axes.set_title("Figure 14: error of Table 2, Canon 1000D 10.48 m high at 67.0 deg")
    _save(figure, axes, path)


def _save(figure: Figure, axes: Axes, path: Path) -> None:
    axes.legend(loc="upper left")
    save_figure(figure, path, "png")
