"""How a camera over a plane turned from one image to the next, from points that were tracked between them.

The points of a plane move by a homography, ``H ~ R + s n'``: the rotation, and the translation over the distance times
the plane's normal (Hartley and Zisserman, Multiple View Geometry, 13.1). Who knows the normal, from telemetry, reads
the rotation off it without the usual two-fold ambiguity. The homography with its covariance is all that is kept of an
image pair, so that the rotation can be asked for again under another normal.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, inverse, matrix, multiply, skew, to_rotation_vector
from aerodft.model.arrays import FloatArray, IntArray

FREE = 8
"""Parameters of a homography of which the last element is 1, row by row."""

_ITERATIONS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaneMotion:
    """Homographies between pairs of images, of rays in camera axes.

    Attributes:
        start_ns: ``(n,)`` stamps of the pairs' earlier images.
        end_ns: ``(n,)`` stamps of the later ones.
        homography: ``(n, 3, 3)``: from rays in the earlier camera to rays in the later one; last element 1.
        cov: ``(n, 8, 8)`` covariance of the other elements, row by row.
    """

    start_ns: IntArray
    end_ns: IntArray
    homography: FloatArray
    cov: FloatArray

    def __len__(self) -> int:
        return len(self.start_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """How a camera turned from image to image.

    Attributes:
        rotvec_rad: ``(n, 3)`` ``earlier_SO3_later``: angular rate in camera axes times the time between the images.
        cov_rad2: ``(n, 3, 3)``.
        chi2: ``(n,)`` misfit of the homography to a plane with this normal; 2 degrees of freedom.
    """

    rotvec_rad: FloatArray
    cov_rad2: FloatArray
    chi2: FloatArray


def turns_over_plane(motion: PlaneMotion, normal_cam: FloatArray, guess_rotvec_rad: FloatArray) -> Turns:
    """The rotation of each pair, by Gauss-Newton, whatever the translation was.

    Args:
        motion: ``n`` pairs.
        normal_cam: ``(n, 3)`` the plane's unit normal in the earlier camera's axes.
        guess_rotvec_rad: ``(n, 3)`` where to start; zeros will do for what a camera turns between two images.
    """
    seen = motion.homography.reshape(-1, 9)[:, :FREE]
    information = np.asarray(np.linalg.inv(motion.cov), dtype=np.float64)
    turn = from_rotation_vector(guess_rotvec_rad)
    shift = np.zeros((len(motion), 3))
    for _ in range(_ITERATIONS):
        back = matrix(inverse(turn))
        whole = back + shift[:, :, None] * normal_cam[:, None, :]
        jac = _derivatives(whole, back, normal_cam)
        off = seen - (whole.reshape(-1, 9) / whole[:, 2, 2, None])[:, :FREE]
        weighted = np.swapaxes(jac, -1, -2) @ information
        step = np.asarray(np.linalg.solve(weighted @ jac, weighted @ off[..., None]), dtype=np.float64)[..., 0]
        turn = multiply(turn, from_rotation_vector(step[:, :3]))
        shift = shift + step[:, 3:]
    left = off - np.einsum("nij,nj->ni", jac, step)
    return Turns(
        rotvec_rad=to_rotation_vector(turn),
        cov_rad2=np.asarray(np.linalg.inv(weighted @ jac), dtype=np.float64)[:, :3, :3],
        chi2=np.einsum("ni,nij,nj->n", left, information, left),
    )


def _derivatives(whole: FloatArray, back: FloatArray, normal_cam: FloatArray) -> FloatArray:
    """``(n, 8, 6)`` of the free elements, by a turn in the later camera's axes and by the shift."""
    by = np.zeros((len(whole), 3, 3, 6))
    by[..., :3] = np.swapaxes(skew(np.swapaxes(back, -1, -2)), 1, 2)
    for axis in range(3):
        by[:, axis, :, 3 + axis] = normal_cam
    last = whole[:, 2, 2, None, None, None]
    scaled = by / last - whole[..., None] * by[:, 2, 2, None, None, :] / last**2
    return scaled.reshape(-1, 9, 6)[:, :FREE]
