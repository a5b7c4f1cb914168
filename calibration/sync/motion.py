"""How the camera turned: by a log, as a smooth function of time and of the gimbal's lag, and by its images alone.

What is seen between two images is precise, but an error stays in all that comes after: the path by the images strays
slowly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, make_smoothing_spline

from aerodft.conventions import SECOND_NS
from aerodft.geometry import (
    camera_from_gimbal,
    from_rotation_vector,
    from_yaw_pitch_roll,
    gimbal_from_camera,
    inverse,
    matrix,
    multiply,
    to_rotation_vector,
)
from aerodft.model import BoolArray, FloatArray, GimbalSource, ReportFrame
from aerodft.service import AttitudeSettings, FixedMount
from aerodft.service.attitude import AttitudeHistory, AttitudeSeries, reference_wxyz
from aerodft.vision.camera_motion import ImagePair, PlaneMotion, Turns

_MIN_SAMPLES = 20  # samples of a curve
_SMOOTHNESS = tuple(10.0**power for power in range(-8, 2))  # s3; weights of the second derivative
_MIN_STD_RAD = 1e-4  # of a turn between two images
_MAX_CHI2 = 100.0  # of two degrees of freedom; more are land and water as one, which turn like neither for seconds
_UNSEEN_RAD = 0.02  # after a second of which no image tells


class _Curve:
    """A smoothing spline of samples ``(n, k)``: what a report's noise does between them is no motion of the camera.

    How smooth, every other sample decides: the curve that the rest of them makes must predict it best.
    """

    def __init__(self, times_s: FloatArray, values: FloatArray, max_gap_s: float) -> None:
        self._times_s = times_s
        self._max_gap_s = max_gap_s
        errors = [_prediction_error(times_s, values, smoothness) for smoothness in _SMOOTHNESS]
        # With twice as many samples, twice the weight keeps the balance.
        self._spline = make_smoothing_spline(times_s, values, lam=2 * _SMOOTHNESS[int(np.argmin(errors))])

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last sample."""
        return float(self._times_s[0]), float(self._times_s[-1])

    def at(self, times_s: FloatArray) -> FloatArray:
        """``(..., k)``; the ends' values outside."""
        return np.asarray(self._spline(np.clip(times_s, *self.span_s)))

    def knows(self, times_s: FloatArray) -> BoolArray:
        """Where there are samples on both sides that are not too far apart."""
        after = np.clip(np.searchsorted(self._times_s, times_s), 1, len(self._times_s) - 1)
        near = self._times_s[after] - self._times_s[after - 1] <= self._max_gap_s
        first_s, last_s = self.span_s
        return np.asarray(near & (times_s >= first_s) & (times_s <= last_s))


def _prediction_error(times_s: FloatArray, values: FloatArray, smoothness: float) -> float:
    """Mean square by which a curve through even samples misses odd ones."""
    curve = make_smoothing_spline(times_s[::2], values[::2], lam=smoothness)
    return float(np.mean((curve(times_s[1:-1:2]) - values[1:-1:2]) ** 2))


class CameraMotion:
    """The camera's attitude by a log, with the gimbal's report taken some time before the vehicle's.

    Attributes:
        source: The report that is believed.
        has_lag: Whether the camera could lag behind it: not where it is bolted to the vehicle.
        report_s: ``(n,)`` when it came, seconds.
        report_wxyz: ``(n, 4)`` what it reported.
    """

    def __init__(
        self, history: AttitudeHistory, settings: AttitudeSettings, zero_ns: int, reach_s: float = np.inf
    ) -> None:
        """Take the first source of the configured order that the log has.

        Args:
            history: The log's attitudes.
            settings: Their order, how cameras are mounted, and the longest gap that is interpolated over.
            zero_ns: UTC from which times in seconds count.
            reach_s: What is farther from there is of no interest.

        Raises:
            LookupError: The log holds no attitude of the camera that could be used.
        """
        history = _cut(history, zero_ns, reach_s)
        self.source = _preferred_source(history, settings)
        self.has_lag = self.source is not GimbalSource.FIXED_MOUNT
        self._zero_ns, self._max_gap_s = zero_ns, settings.max_gap_ns / SECOND_NS
        mount = settings.camera_on_gimbal if self.has_lag else settings.fixed_mount
        self._mount = _mount_wxyz(mount)
        vehicle = _usable(history.vehicle)
        self._reference: _Curve | None = None
        bolted = None if self.has_lag else vehicle
        gimbal = bolted or _of_one_kind(history.gimbals[self.source])
        self.report_s, self.report_wxyz = (gimbal.stamp_ns - zero_ns) / SECOND_NS, gimbal.wxyz
        self._report = self._curve(gimbal, gimbal.wxyz)
        if bolted is not None:
            return
        frame, in_earth = history.frames.get(self.source, ReportFrame.EARTH), bool(gimbal.yaw_in_earth[0])
        if frame is ReportFrame.BODY or not in_earth:
            if vehicle is None:
                raise LookupError(self.source)
            self._reference = self._curve(vehicle, reference_wxyz(vehicle.wxyz, frame, yaw_in_earth=in_earth))

    def _curve(self, series: AttitudeSeries, wxyz: FloatArray) -> _Curve:
        return _Curve((series.stamp_ns - self._zero_ns) / SECOND_NS, _continuous(wxyz), self._max_gap_s)

    def enu_wxyz_cam(self, times_s: FloatArray, lag_s: float = 0.0) -> FloatArray:
        """``(..., 4)``: what the gimbal reported ``lag_s`` before, on what the vehicle then was."""
        attitude = multiply(self._report.at(times_s - lag_s), self._mount)
        if self._reference is not None:
            attitude = multiply(self._reference.at(times_s), attitude)
        return camera_from_gimbal(attitude / np.linalg.norm(attitude, axis=-1, keepdims=True))

    def report_of(self, times_s: FloatArray, enu_wxyz_cam: FloatArray) -> FloatArray:
        """``(n, 4)``: what a gimbal without lag would report of a camera that is there then."""
        gimbal = multiply(gimbal_from_camera(enu_wxyz_cam), inverse(self._mount))
        if self._reference is None:
            return gimbal
        reference = self._reference.at(times_s)
        return multiply(inverse(reference / np.linalg.norm(reference, axis=-1, keepdims=True)), gimbal)

    def knows_reference(self, times_s: FloatArray) -> BoolArray:
        """Where it is known what the report counts from."""
        return np.ones(times_s.shape, dtype=np.bool_) if self._reference is None else self._reference.knows(times_s)

    def knows(self, times_s: FloatArray, lag_s: float = 0.0) -> BoolArray:
        """Mask of the times at which ``enu_wxyz_cam`` lies between samples."""
        return self._report.knows(times_s - lag_s) & self.knows_reference(times_s)


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """What a log says of image pairs.

    Attributes:
        rotvec_rad: ``(n, 3)`` ``earlier_SO3_later`` of the camera.
        normal_cam: ``(n, 3)`` up, in the earlier camera's axes.
        known: ``(n,)`` whether the log has it.
    """

    rotvec_rad: FloatArray
    normal_cam: FloatArray
    known: BoolArray


def predicted(motion: CameraMotion, start_s: FloatArray, end_s: FloatArray, lag_s: float) -> Predicted:
    """The turn between times ``(n,)`` of the log, and where up is."""
    earlier, later = motion.enu_wxyz_cam(start_s, lag_s), motion.enu_wxyz_cam(end_s, lag_s)
    return Predicted(
        rotvec_rad=to_rotation_vector(multiply(inverse(earlier), later)),
        normal_cam=matrix(earlier)[..., 2, :],
        known=motion.knows(start_s, lag_s) & motion.knows(end_s, lag_s),
    )


def _cut(history: AttitudeHistory, zero_ns: int, reach_s: float) -> AttitudeHistory:
    """The attitudes within ``reach_s`` of ``zero_ns``."""

    def near(series: AttitudeSeries) -> AttitudeSeries:
        keep = np.abs(series.stamp_ns - zero_ns) <= reach_s * SECOND_NS
        return AttitudeSeries(
            stamp_ns=series.stamp_ns[keep], wxyz=series.wxyz[keep], yaw_in_earth=series.yaw_in_earth[keep]
        )

    vehicle = None if history.vehicle is None else near(history.vehicle)
    gimbals = {source: near(series) for source, series in history.gimbals.items()}
    return AttitudeHistory(vehicle=vehicle, gimbals=gimbals, frames=history.frames)


def _preferred_source(history: AttitudeHistory, settings: AttitudeSettings) -> GimbalSource:
    for source in settings.order:
        if source is GimbalSource.FIXED_MOUNT:
            if settings.fixed_mount is not None and _usable(history.vehicle) is not None:
                return source
        elif _usable(history.gimbals.get(source)) is not None:
            return source
    raise LookupError(", ".join(settings.order))


def _usable(series: AttitudeSeries | None) -> AttitudeSeries | None:
    return series if series is not None and len(series.stamp_ns) >= _MIN_SAMPLES else None


def _of_one_kind(gimbal: AttitudeSeries) -> AttitudeSeries:
    """The samples whose yaw counts from what most of them count from: no curve leads from one to the other."""
    keep = (gimbal.yaw_in_earth > 0) == (np.mean(gimbal.yaw_in_earth) > 0.5)  # noqa: PLR2004 (the majority)
    return AttitudeSeries(
        stamp_ns=gimbal.stamp_ns[keep], wxyz=gimbal.wxyz[keep], yaw_in_earth=gimbal.yaw_in_earth[keep]
    )


def _mount_wxyz(mount: FixedMount | None) -> FloatArray:
    """``gimbal_SO3_mounted (4,)``."""
    if mount is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return from_yaw_pitch_roll(mount.yaw_rad, mount.pitch_rad, mount.roll_rad)


def _continuous(wxyz: FloatArray) -> FloatArray:
    """Rotations ``(n, 4)`` without changes of the quaternions' sign."""
    flips = np.sum(wxyz[1:] * wxyz[:-1], axis=-1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)])
    return np.asarray(wxyz * signs[:, None])


class CameraPath:
    """``level_SO3_cam`` of some frame that does not move and is about as level as ENU.

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
    whole = turns.chi2 <= _MAX_CHI2
    off = np.maximum(turns.chi2[whole] / 2, 1.0)[:, None, None]
    information = np.linalg.inv(turns.cov_rad2[whole] * off + _MIN_STD_RAD**2 * np.eye(3))
    total, weighted = np.zeros((len(pairs), 3, 3)), np.zeros((len(pairs), 3))
    at = np.searchsorted(start_ns, motion.start_ns[whole])
    np.add.at(total, at, information)
    np.add.at(weighted, at, np.einsum("nij,nj->ni", information, turns.rotvec_rad[whole]))
    seen = np.bincount(at, minlength=len(pairs)) > 0
    var_rad2 = np.full(len(pairs), np.inf)
    var_rad2[seen] = np.trace(np.linalg.inv(total[seen]), axis1=1, axis2=2) / 3
    offset, drift, lag = values.tolist()
    logged = camera.enu_wxyz_cam(offset + (1 + drift) * edges_s, lag)
    rotvec_rad = to_rotation_vector(multiply(inverse(logged[:-1]), logged[1:]))
    rotvec_rad[seen] = np.linalg.solve(total[seen], weighted[seen][..., None])[..., 0]
    return CameraPath(edges_s, rotvec_rad, var_rad2, logged[0])
