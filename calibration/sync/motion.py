"""Camera rotation over time: from a log, as a smooth function of time and gimbal lag, and from images alone.

A rotation between two images is precise, but its error stays in all later ones: the path by the images drifts slowly.
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

_MIN_SAMPLES = 20  # of a curve
_SMOOTHNESS = tuple(10.0**power for power in range(-8, 2))  # s3; weights of the second derivative
_MIN_STD_RAD = 1e-4  # of a turn between two images
_MAX_CHI2 = 100.0  # of two degrees of freedom; more are land and water as one, whose rotation is neither's for seconds
_UNSEEN_STD_RAD = 0.02  # random walk in a second without images


class _SmoothedCurve:
    """Smoothing spline of samples ``(n, k)``, so that the noise of reports is no motion of the camera.

    The smoothness is that whose curve through even samples predicts the odd ones best.
    """

    def __init__(self, times_s: FloatArray, values: FloatArray, max_gap_s: float) -> None:
        self._times_s = times_s
        self._max_gap_s = max_gap_s
        errors = [_prediction_error(times_s, values, smoothness) for smoothness in _SMOOTHNESS]
        # With twice as many samples, twice the weight keeps the balance.
        self._spline = make_smoothing_spline(times_s, values, lam=2 * _SMOOTHNESS[int(np.argmin(errors))])

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and last sample."""
        return float(self._times_s[0]), float(self._times_s[-1])

    def at(self, times_s: FloatArray) -> FloatArray:
        """Values ``(..., k)`` at times; the ends' values outside."""
        return np.asarray(self._spline(np.clip(times_s, *self.span_s)))

    def knows(self, times_s: FloatArray) -> BoolArray:
        """Mask of the times between samples that are near enough to each other."""
        after = np.clip(np.searchsorted(self._times_s, times_s), 1, len(self._times_s) - 1)
        near = self._times_s[after] - self._times_s[after - 1] <= self._max_gap_s
        first_s, last_s = self.span_s
        return np.asarray(near & (times_s >= first_s) & (times_s <= last_s))


def _prediction_error(times_s: FloatArray, values: FloatArray, smoothness: float) -> float:
    """Mean square error of a curve through even samples at the odd ones."""
    curve = make_smoothing_spline(times_s[::2], values[::2], lam=smoothness)
    return float(np.mean((curve(times_s[1:-1:2]) - values[1:-1:2]) ** 2))


class CameraMotion:
    """Camera attitude by a log, with the gimbal's report taken a lag before the vehicle's.

    Attributes:
        source: Source of the attitude reports.
        has_lag: Whether the camera could lag behind them: not where it is bolted to the vehicle.
        report_s: ``(n,)`` times of the reports, seconds.
        report_wxyz: ``(n, 4)`` reported attitudes.
    """

    def __init__(
        self, history: AttitudeHistory, settings: AttitudeSettings, zero_ns: int, reach_s: float = np.inf
    ) -> None:
        """Take the first source of the configured order that the log has.

        Args:
            history: The log's attitudes.
            settings: Their order, how cameras are mounted, and the longest gap that is interpolated over.
            zero_ns: UTC from which times in seconds count.
            reach_s: Largest distance from there of attitudes to use.

        Raises:
            LookupError: The log holds no attitude of the camera that could be used.
        """
        history = _cut(history, zero_ns, reach_s)
        self.source = _preferred_source(history, settings)
        self.has_lag = self.source != GimbalSource.FIXED_MOUNT
        self._zero_ns, self._max_gap_s = zero_ns, settings.max_gap_ns / SECOND_NS
        mount = settings.camera_on_gimbal if self.has_lag else settings.fixed_mount
        self._mount = _mount_wxyz(mount)
        vehicle = _usable(history.vehicle)
        self._reference: _SmoothedCurve | None = None
        bolted = None if self.has_lag else vehicle
        gimbal = bolted or _majority_yaw_reference(history.gimbals[self.source])
        self.report_s, self.report_wxyz = (gimbal.stamp_ns - zero_ns) / SECOND_NS, gimbal.wxyz
        self._report = self._curve(gimbal, gimbal.wxyz)
        if bolted is not None:
            return
        frame, in_earth = history.frames.get(self.source, ReportFrame.EARTH), bool(gimbal.yaw_in_earth[0])
        if frame is ReportFrame.BODY or not in_earth:
            if vehicle is None:
                raise LookupError(self.source)
            self._reference = self._curve(vehicle, reference_wxyz(vehicle.wxyz, frame, yaw_in_earth=in_earth))

    def _curve(self, series: AttitudeSeries, wxyz: FloatArray) -> _SmoothedCurve:
        return _SmoothedCurve((series.stamp_ns - self._zero_ns) / SECOND_NS, _continuous(wxyz), self._max_gap_s)

    def enu_wxyz_cam(self, times_s: FloatArray, lag_s: float = 0.0) -> FloatArray:
        """Camera attitudes ``(..., 4)``: the report of ``lag_s`` before on the vehicle's attitude at each time."""
        attitude = multiply(self._report.at(times_s - lag_s), self._mount)
        if self._reference is not None:
            attitude = multiply(self._reference.at(times_s), attitude)
        return camera_from_gimbal(attitude / np.linalg.norm(attitude, axis=-1, keepdims=True))

    def report_of(self, times_s: FloatArray, enu_wxyz_cam: FloatArray) -> FloatArray:
        """Reports ``(n, 4)`` that a gimbal without lag would give of camera attitudes."""
        gimbal = multiply(gimbal_from_camera(enu_wxyz_cam), inverse(self._mount))
        if self._reference is None:
            return gimbal
        reference = self._reference.at(times_s)
        return multiply(inverse(reference / np.linalg.norm(reference, axis=-1, keepdims=True)), gimbal)

    def knows_reference(self, times_s: FloatArray) -> BoolArray:
        """Mask of the times at which the reference of the reports is known."""
        return np.ones(times_s.shape, dtype=np.bool_) if self._reference is None else self._reference.knows(times_s)

    def knows(self, times_s: FloatArray, lag_s: float = 0.0) -> BoolArray:
        """Mask of the times at which ``enu_wxyz_cam`` lies between samples."""
        return self._report.knows(times_s - lag_s) & self.knows_reference(times_s)


@dataclass(frozen=True, slots=True, eq=False)
class PredictedRotations:
    """Rotations of image pairs predicted by a log.

    Attributes:
        rotvec_rad: ``(n, 3)`` ``earlier_SO3_later`` of the camera.
        normal_cam: ``(n, 3)`` up, in the earlier camera's axes.
        known: ``(n,)`` whether the log has it.
    """

    rotvec_rad: FloatArray
    normal_cam: FloatArray
    known: BoolArray


def predict_rotations(motion: CameraMotion, start_s: FloatArray, end_s: FloatArray, lag_s: float) -> PredictedRotations:
    """Predict rotations and ground normals of image pairs between times ``(n,)`` of the log."""
    earlier, later = motion.enu_wxyz_cam(start_s, lag_s), motion.enu_wxyz_cam(end_s, lag_s)
    return PredictedRotations(
        rotvec_rad=to_rotation_vector(multiply(inverse(earlier), later)),
        normal_cam=matrix(earlier)[..., 2, :],
        known=motion.knows(start_s, lag_s) & motion.knows(end_s, lag_s),
    )


def _cut(history: AttitudeHistory, zero_ns: int, reach_s: float) -> AttitudeHistory:
    """Attitudes within ``reach_s`` of ``zero_ns``."""

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
        if source == GimbalSource.FIXED_MOUNT:
            if settings.fixed_mount is not None and _usable(history.vehicle) is not None:
                return source
        elif _usable(history.gimbals.get(source)) is not None:
            return source
    raise LookupError(", ".join(settings.order))


def _usable(series: AttitudeSeries | None) -> AttitudeSeries | None:
    return series if series is not None and len(series.stamp_ns) >= _MIN_SAMPLES else None


def _majority_yaw_reference(gimbal: AttitudeSeries) -> AttitudeSeries:
    """Samples with the yaw reference of the majority: no curve leads from one to the other."""
    keep = (gimbal.yaw_in_earth > 0) == (np.mean(gimbal.yaw_in_earth) > 0.5)  # noqa: PLR2004 (the majority)
    return AttitudeSeries(
        stamp_ns=gimbal.stamp_ns[keep], wxyz=gimbal.wxyz[keep], yaw_in_earth=gimbal.yaw_in_earth[keep]
    )


def _mount_wxyz(mount: FixedMount | None) -> FloatArray:
    """Rotation ``gimbal_SO3_mounted (4,)``."""
    if mount is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return from_yaw_pitch_roll(mount.yaw_rad, mount.pitch_rad, mount.roll_rad)


def _continuous(wxyz: FloatArray) -> FloatArray:
    """Rotations ``(n, 4)`` with continuous quaternion signs."""
    flips = np.sum(wxyz[1:] * wxyz[:-1], axis=-1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)])
    return np.asarray(wxyz * signs[:, None])


class CameraPath:
    """Camera path ``level_SO3_cam`` by images, in some fixed frame about as level as ENU.

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
            var_rad2: ``(n,)`` variance about each axis; infinite where no image pair was measured.
            first_wxyz: ``(4,)`` at the first image.
        """
        wxyz = np.empty((len(edges_s), 4))
        wxyz[0] = first_wxyz
        for at, turn in enumerate(from_rotation_vector(rotvec_rad)):
            wxyz[at + 1] = multiply(wxyz[at], turn)
        self.span_s = float(edges_s[0]), float(edges_s[-1])
        self._edges_s, self._seen = edges_s, np.isfinite(var_rad2)
        unseen = _UNSEEN_STD_RAD**2 * np.diff(edges_s)
        self._drift_var_rad2 = np.concatenate([[0.0], np.cumsum(np.where(self._seen, var_rad2, unseen))])
        self._curve = CubicSpline(edges_s, wxyz)

    def at(self, times_s: FloatArray) -> FloatArray:
        """Attitudes ``(..., 4)`` at times within the span."""
        wxyz = np.asarray(self._curve(times_s))
        return np.asarray(wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True))

    def stray_rad(self, times_s: FloatArray) -> FloatArray:
        """Standard deviation ``(n - 1,)`` about an axis of the drift between successive times ``(n,)``."""
        return np.asarray(np.sqrt(np.diff(np.interp(times_s, self._edges_s, self._drift_var_rad2))))

    def sees(self, times_s: FloatArray) -> BoolArray:
        """Mask of the times between measured images."""
        pair = np.searchsorted(self._edges_s, times_s, side="right") - 1
        inside = (pair >= 0) & (pair < len(self._seen))
        return np.asarray(inside & self._seen[np.clip(pair, 0, len(self._seen) - 1)])


def integrated_path(
    pairs: Sequence[ImagePair],
    motion: PlaneMotion,
    turns: Turns,
    camera: CameraMotion,
    values: FloatArray,
    zero_ns: int,
) -> CameraPath:
    """Path through successive image pairs; the log's where nothing was measured.

    Args:
        pairs: Image pairs, each beginning where the one before ends.
        motion: Plane motions in them, one or two to a pair.
        turns: Camera rotation by each motion.
        camera: The log.
        values: ``(3,)`` estimated offset (s, at ``zero_ns``), drift and lag (s).
        zero_ns: Origin of the video's time.
    """
    start_ns = np.array([pair.start_ns for pair in pairs], dtype=np.int64)
    edges_s = (np.append(start_ns, pairs[-1].end_ns) - zero_ns) / SECOND_NS
    is_consistent = turns.chi2 <= _MAX_CHI2
    misfit = np.maximum(turns.chi2[is_consistent] / 2, 1.0)[:, None, None]
    information = np.linalg.inv(turns.cov_rad2[is_consistent] * misfit + _MIN_STD_RAD**2 * np.eye(3))
    total, weighted = np.zeros((len(pairs), 3, 3)), np.zeros((len(pairs), 3))
    at = np.searchsorted(start_ns, motion.start_ns[is_consistent])
    np.add.at(total, at, information)
    np.add.at(weighted, at, np.einsum("nij,nj->ni", information, turns.rotvec_rad[is_consistent]))
    seen = np.bincount(at, minlength=len(pairs)) > 0
    var_rad2 = np.full(len(pairs), np.inf)
    var_rad2[seen] = np.trace(np.linalg.inv(total[seen]), axis1=1, axis2=2) / 3
    offset, drift, lag = values.tolist()
    logged = camera.enu_wxyz_cam(offset + (1 + drift) * edges_s, lag)
    rotvec_rad = to_rotation_vector(multiply(inverse(logged[:-1]), logged[1:]))
    rotvec_rad[seen] = np.linalg.solve(total[seen], weighted[seen][..., None])[..., 0]
    return CameraPath(edges_s, rotvec_rad, var_rad2, logged[0])
