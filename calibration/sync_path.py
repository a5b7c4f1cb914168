"""How the camera moved by its images alone: their turns, one after the other, as a smooth function of the video's time.

What is seen between two images is precise, but an error stays in all that comes after: the path strays slowly.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import from_rotation_vector, inverse, multiply, to_rotation_vector
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.matches import ImagePair
from aerodft.vision.rotation import PlaneMotion, Turns
from calibration.sync_motion import CameraMotion

_LEAST_STD_RAD = 1e-4  # of a turn between two images
_MOST_CHI2 = 100.0  # of two degrees of freedom; more are land and water as one, which turn like neither for seconds
_UNSEEN_RAD = 0.02  # after a second of which no image tells


class CameraPath:
    """``steady_SO3_cam`` of some steady frame that is level about as ENU is.

    Attributes:
        span_s: First and last image, seconds since the reference by the video's clock.
    """

    def __init__(
        self, edges_s: FloatArray, rotvec_rad: FloatArray, var_rad2: FloatArray, first_wxyz: FloatArray
    ) -> None:
        """Chain turns.

        Args:
            edges_s: ``(n + 1,)`` of the images, ascending.
            rotvec_rad: ``(n, 3)`` from each image to the next, ``earlier_SO3_later``.
            var_rad2: ``(n,)`` variance about each axis; infinite where the images do not tell.
            first_wxyz: ``(4,)`` at the first image.
        """
        wxyz = np.empty((len(edges_s), 4))
        wxyz[0] = first_wxyz
        for at, turn in enumerate(from_rotation_vector(rotvec_rad)):
            wxyz[at + 1] = multiply(wxyz[at], turn)
        self.span_s = float(edges_s[0]), float(edges_s[-1])
        self._edges_s, self._seen = edges_s, np.isfinite(var_rad2)
        unseen = _UNSEEN_RAD**2 * np.diff(edges_s)
        self._strayed_rad2 = np.concatenate([[0.0], np.cumsum(np.where(self._seen, var_rad2, unseen))])
        self._curve = CubicSpline(edges_s, wxyz)

    def at(self, times_s: FloatArray) -> FloatArray:
        """``(..., 4)``, within the span."""
        wxyz = np.asarray(self._curve(times_s))
        return np.asarray(wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True))

    def stray_rad(self, times_s: FloatArray) -> FloatArray:
        """``(n - 1,)``: standard deviation about an axis of what it strays between successive times ``(n,)``."""
        return np.asarray(np.sqrt(np.diff(np.interp(times_s, self._edges_s, self._strayed_rad2))))

    def sees(self, times_s: FloatArray) -> BoolArray:
        """Whether images tell how the camera turned then."""
        pair = np.searchsorted(self._edges_s, times_s, side="right") - 1
        inside = (pair >= 0) & (pair < len(self._seen))
        return np.asarray(inside & self._seen[np.clip(pair, 0, len(self._seen) - 1)])


def followed_path(
    pairs: Sequence[ImagePair],
    motion: PlaneMotion,
    turns: Turns,
    camera: CameraMotion,
    values: FloatArray,
    zero_ns: int,
) -> CameraPath:
    """The path through successive image pairs; where nothing was seen, the log's.

    Args:
        pairs: All of them, each beginning where the one before ends.
        motion: What moved alike in them, one or two to a pair.
        turns: How the camera turned by each.
        camera: The log.
        values: ``(3,)`` offset (s, at ``zero_ns``), drift and lag (s), as far as they are known.
        zero_ns: From where the video's time counts.
    """
    start_ns = np.array([pair.start_ns for pair in pairs], dtype=np.int64)
    edges_s = (np.append(start_ns, pairs[-1].end_ns) - zero_ns) / SECOND_NS
    whole = turns.chi2 <= _MOST_CHI2
    off = np.maximum(turns.chi2[whole] / 2, 1.0)[:, None, None]
    information = np.linalg.inv(turns.cov_rad2[whole] * off + _LEAST_STD_RAD**2 * np.eye(3))
    total, weighted = np.zeros((len(pairs), 3, 3)), np.zeros((len(pairs), 3))
    at = np.searchsorted(start_ns, motion.start_ns[whole])
    np.add.at(total, at, information)
    np.add.at(weighted, at, np.einsum("nij,nj->ni", information, turns.rotvec_rad[whole]))
    seen = np.bincount(at, minlength=len(pairs)) > 0
    var_rad2 = np.full(len(pairs), np.inf)
    var_rad2[seen] = np.trace(np.linalg.inv(total[seen]), axis1=1, axis2=2) / 3
    offset, drift, lag = values.tolist()
    said = camera.enu_wxyz_cam(offset + (1 + drift) * edges_s, lag)
    rotvec_rad = to_rotation_vector(multiply(inverse(said[:-1]), said[1:]))
    rotvec_rad[seen] = np.linalg.solve(total[seen], weighted[seen][..., None])[..., 0]
    return CameraPath(edges_s, rotvec_rad, var_rad2, said[0])
