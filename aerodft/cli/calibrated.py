"""Camera and pose out of a calibration file, as commands about one image take them."""

from dataclasses import replace
from pathlib import Path

from aerodft.adapters.config.calibration import load_calibrated_lens, load_calibrated_pose, load_calibration
from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.fixed_pose import pose_sample
from aerodft.cli.given import GivenGround
from aerodft.cli.stds import Stds, parse_stds
from aerodft.dft.request import Setup
from aerodft.errors import UsageError
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import PoseSample, PoseStd
from aerodft.model.pose_batch import PoseBatch
from calibration.biases import BiasCalibrator


def calibrated(
    path: Path, camera: Path | None, model: ProjectionModel | None, std: str | None, terms: GivenGround
) -> tuple[Setup, PoseSample, Stds]:
    """What a calibration that has a pose says, with the stds that it does not know.

    Args:
        path: The calibration.
        camera: The camera's file, where the calibration took the lens as it was.
        model: Projection model that was asked for.
        std: As ``--std`` was given: px and elevation alone.
        terms: The ground.

    Raises:
        UsageError: Options that do not go together.
    """
    stds = parse_stds(std) if std else Stds()
    if stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --calibration", expected="px, elevation: the pose's are in the file")
    fixed, (lens, own_model) = load_calibrated_pose(path), load_calibrated_lens(path)
    assert fixed is not None  # noqa: S101 - who calls this has looked, for the type checker
    if model not in (None, own_model):
        raise UsageError(f"--model {model} beside --calibration", expected=f"{own_model}, which it was made with")
    if lens is None and camera is None:
        raise UsageError("--calibration without --camera", expected="both: the calibration took the lens as it was")
    lens = stds.on_camera(load_camera(camera)) if lens is None and camera is not None else lens
    flat = pose_sample(fixed, None)
    surface, origin = terms.ground(flat.origin)
    sample = flat if surface is None else pose_sample(fixed, origin, surface, str(path))
    assert lens is not None  # noqa: S101 - one of the two was there, for the type checker
    return Setup(camera=lens, model=own_model, ground=surface), sample, stds


def corrected(setup: Setup, sample: PoseSample, path: Path) -> tuple[Setup, PoseSample]:
    """Camera and pose by telemetry, without what a calibration says that telemetry is off by."""
    lens, own_model = load_calibrated_lens(path)
    if lens is not None and setup.model is not own_model:
        raise UsageError(f"--model {setup.model} beside --calibration", expected=f"{own_model}, which it was made with")
    refined = BiasCalibrator(load_calibration(path)).refine(PoseBatch.of([sample]))
    return replace(setup, camera=lens or setup.camera), refined[0]
