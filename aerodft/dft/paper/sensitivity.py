"""Table 3 of the paper: origin of its percentages, and the true derivatives of Eq. 4 to 6."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft import equations
from aerodft.dft.paper.printed import TABLE_1, TABLE_3, PrintedSensitivity

PSI_RAD: Final = tuple(map(math.radians, (0.0, 30.0, 60.0, 85.0)))
"""Vertical angles at which the true figures are given; Table 3 names none."""

PHI_RAD: Final = (0.0, TABLE_1[0].camera.hfov_rad / 2)
"""Rotation angles of the true figures: the image's middle, and the border of the widest camera of Table 1."""

_NADIR_RAD, _DIAGONAL_RAD = 0.0, math.pi / 4

Percent = tuple[float, float, float]
"""Of X, Y and Z, in percent of the camera height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivity:
    """Changes of X, Y and Z by an input's error at one direction of view.

    Attributes:
        psi_rad: Vertical angle.
        phi_rad: Rotation angle.
        derivative_percent: The derivative times the input's error.
        change_percent: The finite change, with the error applied in full.
    """

    psi_rad: float
    phi_rad: float
    derivative_percent: Percent
    change_percent: Percent


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityRow:
    """A row of Table 3, computed.

    Attributes:
        printed: The paper's row.
        holds_at: A direction of view at which the printed X and Y are the true changes.
        displacement_percent: Length of the vector of all changes there (X, Y and, where it is the input, h). This is
            what the paper prints for Z: how far the ground point moves, an upper bound of the change of Z.
        true: At every ``PSI_RAD`` and ``PHI_RAD``.
    """

    printed: PrintedSensitivity
    holds_at: Sensitivity
    displacement_percent: float
    true: tuple[Sensitivity, ...]


def table_3() -> tuple[SensitivityRow, ...]:
    """Recompute Table 3, row by row."""
    return tuple(_row(printed) for printed in TABLE_3)


def sensitivity(printed: PrintedSensitivity, psi_rad: float, phi_rad: float) -> Sensitivity:
    """Changes by the errors of a row of Table 3 at one direction of view, Eq. 4 to 6, camera height 1 m."""
    y = math.tan(psi_rad)
    x = y * math.tan(phi_rad)
    z = math.sqrt(1 + x**2 + y**2)
    d_psi, d_phi, d_h = printed.delta_psi_rad, printed.delta_phi_rad, printed.delta_height
    d_y = y * d_h + d_psi / math.cos(psi_rad) ** 2
    d_x = d_y * math.tan(phi_rad) + y * d_phi / math.cos(phi_rad) ** 2
    d_z = (d_h + y * d_y + x * d_x) / z
    change = _point(1 + d_h, psi_rad + d_psi, phi_rad + d_phi) - _point(1.0, psi_rad, phi_rad)
    return Sensitivity(
        psi_rad=psi_rad,
        phi_rad=phi_rad,
        derivative_percent=(100 * d_x, 100 * d_y, 100 * d_z),
        change_percent=(float(100 * change[0]), float(100 * change[1]), float(100 * change[2])),
    )


def _point(height: float, psi_rad: float, phi_rad: float) -> np.ndarray:
    right, ahead = equations.ground_point(height, psi_rad, phi_rad)
    return np.array([right, ahead, equations.depth(height, ahead, right)])


def _row(printed: PrintedSensitivity) -> SensitivityRow:
    # tan(dpsi) is the change of Y / h straight down only; h or phi act through Y = h, so at 45 deg only; and X changes
    # as much as Y only where tan(phi) = 1.
    psi = _NADIR_RAD if printed.delta_psi_rad else _DIAGONAL_RAD
    phi = _NADIR_RAD if printed.delta_phi_rad else _DIAGONAL_RAD
    holds_at = sensitivity(printed, psi, phi)
    return SensitivityRow(
        printed=printed,
        holds_at=holds_at,
        displacement_percent=math.hypot(*holds_at.change_percent[:2], 100 * printed.delta_height),
        true=tuple(sensitivity(printed, psi, phi) for psi in PSI_RAD for phi in PHI_RAD),
    )
