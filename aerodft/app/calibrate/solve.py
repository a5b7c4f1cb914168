"""A calibration from files to a result that can be read, saved and shown."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from aerodft.adapters.config.camera import FixedPose, load_camera, write_calibration
from aerodft.adapters.config.evidence import EvidenceFile, Flight, check_against, load_evidence
from aerodft.adapters.images import check_mode
from aerodft.app import Progress, no_progress
from aerodft.app.calibrate.checks import check_unique, check_unknowns, not_determined, unstated_value, wrong_unknowns
from aerodft.app.calibrate.image_poses import views_of
from aerodft.app.calibrate.markers import detected_evidence
from aerodft.app.measure import projection_model
from aerodft.errors import AerodftError, UsageError
from aerodft.model import BIASES, BiasValues, Calibration, Camera, FloatArray, PoseStd, ProjectionModel
from aerodft.reports.calibration import (
    calibration_document,
    calibration_notes,
    displayed_covariance,
    displayed_values,
    write_calibration_page,
)
from aerodft.version import SOFTWARE
from calibration.diagnosis import Attempt, likely_mistake
from calibration.flight import ImagesResult, calibrate_images, typical_noise
from calibration.pose import Result, angles_deg, expand_groups
from calibration.pose import calibrate as solve_for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationResult:
    """Result of a calibration.

    Attributes:
        fit: The fit of a camera that stands still, or of many images of a flight.
        evidence: The file that it is from.
        unknowns: What was asked for.
        inputs: Names and hashes of other files that it is from, for the provenance.
        mistake: What looks wrong with evidence that does not fit; None where nothing does.
        accept_misfit: Observations that contradict each other are no reason to refuse it.
    """

    fit: Result | ImagesResult
    evidence: EvidenceFile
    unknowns: tuple[str, ...]
    inputs: dict[str, Any] = field(default_factory=dict)
    mistake: AerodftError | None = None
    accept_misfit: bool = False

    @property
    def camera(self) -> Camera:
        """The camera with its lens as found or known, and how well."""
        return self.fit.camera

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by names with units (``height_agl_m``, ``tilt_deg``, ``focal_px``, ...)."""
        return displayed_values(self.fit, self.evidence.frame)

    @property
    def stds(self) -> dict[str, float]:
        """Standard deviations of the values, by the same names and in the same units."""
        return dict(zip(self.fit.display_units, displayed_covariance(self.fit)[1].tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """``(n, n)`` of the values, in their order and units."""
        return displayed_covariance(self.fit)[0]

    @property
    def notes(self) -> list[str]:
        """Sentences worth knowing: rejected observations, stds that are too small, doubts about images."""
        return calibration_notes(self.fit, self.evidence)

    def refusal(self, *, is_saved: bool = False) -> AerodftError | None:
        """Why it cannot be used; None where it can.

        Args:
            is_saved: It goes into a file, which needs a height and a tilt.
        """
        if isinstance(self.fit, ImagesResult):
            return not_determined(self.fit, self.evidence, accept_misfit=self.accept_misfit)
        missing = self.mistake or unstated_value(self.fit, self.evidence, is_saved=is_saved)
        return missing or not_determined(self.fit, self.evidence, accept_misfit=self.accept_misfit)

    def document(self, *, is_saved: bool = False) -> dict[str, Any]:
        """Everything as ``aerodft calibrate --json`` prints it, with why it cannot be used, as ``refusal``."""
        return calibration_document(self.fit, self.evidence, self.refusal(is_saved=is_saved))

    def save(self, path: Path | str) -> None:
        """Write a calibration file that stations, ``measure`` and ``recompute`` take.

        Args:
            path: The TOML file; one that is there is replaced.

        Raises:
            NotDetermined: A height or tilt that the file needs was neither stated nor asked for.
            InputError: It cannot be written.
        """
        if error := self.refusal(is_saved=True):
            raise error
        if isinstance(self.fit, ImagesResult):
            found: FixedPose | Calibration = _biases(self.fit, self.evidence)
            points = None
            model = self.fit.solution.state.base.model
        else:
            found = _fixed_pose(self.fit, self.evidence)
            rejected = {left.name for left in self.fit.left if left.is_outlier}
            kept = {name: point for name, point in self.evidence.points.items() if name not in rejected}
            points = kept, float(self.evidence.frame.origin[2])
            model = self.fit.solution.state.model
        lens = self.camera if np.any(self.camera.covariance) else None
        provenance = {
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "software": SOFTWARE,
            "observations": self.evidence.path.name,
            "observations_sha256": self.evidence.sha256,
            **self.inputs,
            "unknowns": list(self.unknowns),
            "rms_px": self.fit.rms_px,
            "chi2": self.fit.solution.chi2,
            "degrees_of_freedom": self.fit.solution.dof,
            "misfit": self.fit.solution.misfit,
            "sigma_scale": self.fit.solution.sigma_scale,
            "misfit_accepted": True if not_determined(self.fit, self.evidence, accept_misfit=False) else None,
            "outliers": [left.name for left in self.fit.left if left.is_outlier],
        }
        write_calibration(Path(path), found, lens, model, provenance, points)

    def write_report(self, folder: Path | str) -> Path:
        """Write a page with pictures and tables.

        Args:
            folder: The folder, made where it is not there.

        Returns:
            The page, ``report.md``; beside it residuals as figure and CSV, and the image with the ground's metres.

        Raises:
            InputError: The folder cannot be written to.
        """
        return write_calibration_page(self.fit, self.evidence, Path(folder))


def calibrate(  # noqa: PLR0913 - each is something that a person knows
    evidence: Path | str,
    camera: Camera | Path | str,
    unknowns: Sequence[str] = ("height", "tilt"),
    *,
    model: ProjectionModel | str = ProjectionModel.PINHOLE,
    crs: str | None = None,
    plane_elevation_m: float | None = None,
    image: str | None = None,
    telemetry: Path | str | None = None,
    images: Sequence[Path | str] | None = None,
    progress: Progress = no_progress,
    accept_misfit: bool = False,
    check: bool = True,
) -> CalibrationResult:
    """Find a camera's pose (and lens) from landmarks, ranges, lengths, heights, verticals, lines and the horizon.

    With several images in the file, each with a pose by telemetry: what telemetry is off by, in all of them.

    Args:
        evidence: What is known: TOML, CSV with a row for each landmark, or OpenDroneMap's ``gcp_list.txt``; with
            ``images``, a file of markers.
        camera: The camera, or its file.
        unknowns: What to find: height, tilt, roll, heading, position, focal (or fx, fy), principal_point, elevation,
            k1, k2, ...; in many images height, tilt, roll, heading, pan, position and time.
        model: ``"pinhole"``, or the paper's ``"dft"``.
        crs: Of a CSV file: local, geo or an EPSG code.
        plane_elevation_m: Of a CSV file or list of ground control points: elevation of the measured plane, in the
            heights of the landmarks.
        image: Of a list of ground control points in several images: the one that the camera took.
        telemetry: Log or recording that the poses of the file's images are looked up in.
        images: Stills, folders or videos in which the surveyed ArUco or AprilTag markers of ``evidence`` are found.
        progress: Called with how many thousandths of these images are done, and 1000.
        accept_misfit: Take observations that contradict each other by far more than stated, with stds scaled up.
        check: Raise what ``refusal`` would return; without, a fit that cannot be used is returned too, to be looked at.

    Returns:
        What was found, with its covariance; ``save`` writes the file that stations take.

    Raises:
        NotDetermined: The evidence does not determine what is asked for, or contradicts itself; says what to add.
        InputError: A file is missing, unreadable or impossible, or the evidence looks mistaken: says what fits.
        UsageError: Unknowns or a model that there are not.

    Examples:
        >>> import aerodft as ad
        >>> found = ad.calibrate(
        ...     "configs/calibration/bridge-landmarks.toml",
        ...     "configs/cameras/demo-1080p.toml",
        ...     unknowns=["position", "height", "tilt", "roll", "heading", "focal"],
        ... )
        >>> round(found.values["tilt_deg"], 1), round(found.stds["tilt_deg"], 2)
        (62.3, 0.04)
        >>> found.save("bridge.toml")
    """
    lens = camera if isinstance(camera, Camera) else load_camera(Path(camera))
    names = (unknowns,) if isinstance(unknowns, str) else tuple(unknowns)
    model = projection_model(model)
    check_unique(names)
    if images is None:
        known = load_evidence(Path(evidence), crs, plane_elevation_m, image)
        known = known.with_notes(*check_mode(known.image_paths, lens))
    elif crs is None and plane_elevation_m is None and image is None:
        known = detected_evidence(Path(evidence), list(map(Path, images)), lens, names, model, progress)
    else:
        what = "`crs`, `plane_elevation_m` or `image` beside images of markers"
        raise UsageError(what, expected="crs and elevation_m in the file of markers")
    check_against(known, lens)
    found = _solve(known, lens, names, model, None if telemetry is None else Path(telemetry))
    if not isinstance(camera, Camera):
        sha256 = {"camera_sha256": _sha256(Path(camera))} if known.flight is None else {}
        found = replace(found, inputs=found.inputs | {"camera_file": Path(camera).name} | sha256)
    found = replace(found, accept_misfit=accept_misfit)
    if check and (error := found.refusal()):
        raise error
    return found


def _solve(
    evidence: EvidenceFile, camera: Camera, names: tuple[str, ...], model: ProjectionModel, telemetry: Path | None
) -> CalibrationResult:
    """Pose and lens of a camera that stands still, or what telemetry is off by in all images of a flight."""
    if evidence.flight is not None:
        return _solve_flight(evidence, evidence.flight, camera, names, model, telemetry)
    if telemetry is not None:
        raise UsageError("`telemetry`", got="a file without [[image]]", expected="images whose poses are looked up")
    check_unknowns(names, evidence.known, camera, model)
    fit = solve_for(evidence.known, camera, names, model)
    return CalibrationResult(
        fit=fit,
        evidence=evidence,
        unknowns=names,
        inputs={"images_sha256": {each.name: _sha256(each) for each in evidence.image_paths} or None},
        mistake=likely_mistake(Attempt(evidence, camera, names, model, fit)),
    )


def _solve_flight(
    evidence: EvidenceFile,
    flight: Flight,
    camera: Camera,
    names: tuple[str, ...],
    model: ProjectionModel,
    telemetry: Path | None,
) -> CalibrationResult:
    """Fit of the telemetry's biases over all images of a flight."""
    views, priors = views_of(evidence, flight, telemetry, needs_time="time" in expand_groups(names))
    try:
        fit = calibrate_images(views, priors, camera, names, model)
    except ValueError as error:
        raise wrong_unknowns(error) from None
    log = telemetry or flight.log
    inputs = {"telemetry": None if log is None else log.name, "camera_file": None, "images": len(views)}
    return CalibrationResult(fit=fit, evidence=evidence, unknowns=names, inputs=inputs)


def _sha256(path: Path) -> str:
    """Hash of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _to_true_north(turn_rad: float) -> FloatArray:
    """``(2, 2)`` from eastings and northings to true east and north, which are turned by so much clockwise."""
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    return np.array([[cos, sin], [-sin, cos]])


def _fixed_pose(fit: Result, evidence: EvidenceFile) -> FixedPose:
    """The pose as stations take it: on the map with true north where the file's coordinates are on one."""
    state, cov, lens = fit.solution.state, fit.pose_covariance.copy(), fit.lens_covariance.copy()
    tilt_deg, roll_deg, heading_deg = angles_deg(state)
    place, heading_rad = evidence.frame.wgs84(state.position_m), math.radians(heading_deg)
    true_rad = evidence.frame.true_heading_rad(heading_rad)
    if true_rad is not None:
        to_true = _to_true_north(true_rad - heading_rad)
        cov[:2] = to_true @ cov[:2]
        cov[:, :2] = cov[:, :2] @ to_true.T
        lens[:2] = to_true @ lens[:2]
        heading_rad = true_rad
    stds = np.sqrt(np.maximum(np.diag(cov), 0.0))
    by_name = dict(zip(fit.names, np.sqrt(np.maximum(np.diag(fit.named_covariance), 0.0)).tolist(), strict=True))
    here_m = state.position_m if place is not None else evidence.frame.file_coordinates(state.position_m)
    return FixedPose(
        height_agl_m=float(state.position_m[2]) - state.elevation_m,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=heading_rad,
        lat_rad=None if place is None else float(place[0]),
        lon_rad=None if place is None else float(place[1]),
        alt_msl_m=None if place is None else float(place[2]),
        std=PoseStd(
            height_agl_m=by_name.get("height", 0.0),
            horizontal_m=float(np.hypot(*stds[:2])) / math.sqrt(2),
            tilt_rad=by_name.get("tilt", 0.0),
            roll_rad=by_name.get("roll", 0.0),
            heading_rad=by_name.get("heading", 0.0),
        ),
        covariance=tuple(map(tuple, cov.tolist())),
        lens_covariance=tuple(map(tuple, lens.tolist())) if np.any(lens) else (),
        east_m=float(here_m[0]),
        north_m=float(here_m[1]),
    )


def _biases(fit: ImagesResult, evidence: EvidenceFile) -> Calibration:
    """The biases as stations take them: east and north are true ones."""
    count, places = len(BIASES), [BIASES.index("east"), BIASES.index("north")]
    to_true = np.eye(count)
    to_true[np.ix_(places, places)] = _to_true_north(evidence.frame.true_heading_rad(0.0) or 0.0)
    height, tilt, roll, heading, pan, east, north, time = fit.solution.state.biases.tolist()
    east, north = (to_true[np.ix_(places, places)] @ [east, north]).tolist()
    cov = to_true @ fit.bias_covariance
    lens = cov[:, count:]
    return Calibration(
        id="",
        bias=BiasValues(
            height_m=height - fit.ground_m,
            tilt_rad=tilt,
            roll_rad=roll,
            heading_rad=heading,
            pan_rad=pan,
            east_m=east,
            north_m=north,
            time_s=time,
        ),
        bias_cov=cov[:, :count] @ to_true.T,
        lens_cov=lens if np.any(lens) else None,
        noise=typical_noise([view.noise for view in fit.problem.views]),
    )
