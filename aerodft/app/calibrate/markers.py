"""Evidence from surveyed markers that images show."""

import math
import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile, MarkersFile, load_markers
from aerodft.adapters.images import STILLS, NamedImage, check_mode, image_files, named_images, refuse_other_size
from aerodft.app import Progress, no_progress
from aerodft.app.calibrate.checks import check_unknowns
from aerodft.errors import InputError, NotDetermined, Reason, UsageError
from aerodft.model import Camera, FloatArray, ImageArray, MarkerSighting, ProjectionModel, Px, marker_name
from calibration.markers import MIN_SIDE_PX, Judgement, Miss, find_markers, judge, other_dictionary
from calibration.pose import calibrate

_THOROUGH: Final = 3  # images that are looked into in every way; of a video, the others show the same
_PROGRESS: Final = 1000
_MOVED_PX, _MOVED_STDS = 2.0, 5.0


_Sightings: TypeAlias = dict[int, MarkerSighting]
"""The surveyed markers that one image shows, by their ids."""


def detected_evidence(
    markers: Path,
    images: Sequence[Path],
    camera: Camera,
    names: tuple[str, ...],
    model: ProjectionModel = ProjectionModel.PINHOLE,
    progress: Progress = no_progress,
) -> EvidenceFile:
    """Evidence from markers: all that their file says, with a landmark for each that is seen and can be true.

    Args:
        markers: File of surveyed markers.
        images: Stills, folders or videos of one view: the camera stands still.
        camera: Whose images they are.
        names: What the evidence is for: the unknowns that markers must agree on, as ``calibration.pose`` names them.
        model: Projection model.
        progress: Called with thousandths of the images.

    Returns:
        The evidence, and in ``notes`` what was not seen, what was rejected and why, and how far poses miss a marker
        that they have not seen.

    Raises:
        UsageError: No images, or unknowns that there are not.
        ConfigError: The file of markers is wrong.
        InputError: An image is unreadable or of another size than the camera's, shows a marker twice or one that is
            not surveyed, or the camera moved.
        NotDetermined: No surveyed marker is seen, or they contradict each other.
    """
    file = load_markers(markers)
    if not images:
        raise UsageError("`images`", got="none", expected="images, a folder of images or a video")
    paths = tuple(image_files(images))
    doubts = check_mode(paths, camera)
    seen, first = _look(file, paths, camera, progress)
    together, moved = _combined(seen, camera)
    if not together:
        raise _nothing(file, first, len(seen))
    picture = images[0] if images[0].suffix.lower() in STILLS and images[0].is_file() else None
    image = None if picture is None else os.path.relpath(picture, markers.parent)
    size_px = (camera.width_px, camera.height_px)
    found = file.evidence([together[marker] for marker in sorted(together)], size_px, image)
    check_unknowns(names, found.known, camera, model)
    sides_m = {marker: each.side_m for marker, each in file.survey.by_id.items() if each.side_m is not None}
    judgement = judge(found.known, together, sides_m, partial(calibrate, camera=camera, names=names, model=model))
    if judgement.conflict:
        hint = "check ids, places, side_m and std_m, or add markers"
        got = f"{_ids(together)}: {judgement.conflict}"
        raise NotDetermined("the markers contradict each other", where=markers, got=Reason(got), hint=hint)
    unseen = sorted(set(file.survey.by_id).difference(*seen.values()))
    notes = (*doubts, *_notes(unseen, moved, together, judgement))
    kept = {each.name for each in judgement.known.evidence}
    stated = (each for each, evidence in zip(found.stated, found.known.evidence, strict=True) if evidence.name in kept)
    return replace(found, known=judgement.known, stated=tuple(stated), notes=notes, image_paths=paths)


def _look(
    file: MarkersFile, images: Sequence[Path], camera: Camera, progress: Progress
) -> tuple[dict[str, _Sightings], NamedImage]:
    """Markers seen in every image, by its name, and the first image."""
    seen: dict[str, _Sightings] = {}
    first: NamedImage | None = None
    for image in named_images(images):
        first = first or image
        height_px, width_px = image.pixels.shape[:2]
        refuse_other_size((width_px, height_px), camera, image.name)
        found = find_markers(image.pixels, file.survey, camera, thorough=len(seen) < _THOROUGH)
        seen[image.name] = _by_id(found, file, image.name)
        progress(round(_PROGRESS * image.done), _PROGRESS)
    if first is None:
        raise InputError("no image could be read", where=images[0], expected="images, folders of images or videos")
    return seen, first


def _by_id(found: Sequence[MarkerSighting], file: MarkersFile, image: str) -> _Sightings:
    """The sightings of surveyed markers by id."""
    surveyed, by_id = file.survey.by_id, dict[int, MarkerSighting]()
    for each in found:
        if each.id in file.ignore:
            continue
        if each.id not in surveyed:
            raise InputError(
                f"marker {each.id} is not surveyed",
                where=image,
                got=f"it at {_at(each.pixel)}",
                expected=f"{_ids(surveyed)} of {file.path}",
                hint=f"survey it, or write ignore = [{each.id}] there",
            )
        if each.id in by_id:
            raise InputError(
                f"marker {each.id} is there twice",
                where=image,
                got=f"it at {_at(by_id[each.id].pixel)} and at {_at(each.pixel)}",
                expected="each id once",
                hint="cover one of the two, or give it another id",
            )
        by_id[each.id] = each
    return by_id


def _combined(seen: dict[str, _Sightings], camera: Camera) -> tuple[_Sightings, dict[int, float]]:
    """One sighting of each marker from all images, and by how many px others moved between them."""
    by_id: dict[int, list[MarkerSighting]] = {}
    for sightings in seen.values():
        for marker, sighting in sightings.items():
            by_id.setdefault(marker, []).append(sighting)
    typical = {marker: _typical(several) for marker, several in by_id.items()}
    for image, sightings in seen.items():
        excess = [_excess(sighting, typical[marker]) for marker, sighting in sightings.items()]
        if excess and np.median(excess) > 0:
            px = np.median([math.dist(each.pixel, typical[marker].pixel) for marker, each in sightings.items()])
            raise InputError(
                "the camera moved between the images",
                where=image,
                got=f"markers {px:.0f} px from where they are in the others",
                expected=f'one view of camera "{camera.name}"',
                hint="calibrate each view by itself",
            )
    moved = {
        marker: max(math.dist(each.pixel, typical[marker].pixel) for each in several)
        for marker, several in by_id.items()
        if any(_excess(each, typical[marker]) > 0 for each in several)
    }
    return {marker: each for marker, each in typical.items() if marker not in moved}, moved


def _excess(sighting: MarkerSighting, typical: MarkerSighting) -> float:
    """Distance beyond that which chance allows, px."""
    return math.dist(sighting.pixel, typical.pixel) - _MOVED_PX - _MOVED_STDS * sighting.std_px


def _typical(sightings: Sequence[MarkerSighting]) -> MarkerSighting:
    """The median of a marker's sightings; more of them take away noise, but not what they have in common."""
    pixels = np.array([each.pixel for each in sightings])
    corners = np.array([each.corners for each in sightings])
    scatter_px = float(np.median(np.linalg.norm(pixels - np.median(pixels, axis=0), axis=1)))
    first, second, third, fourth = (_px(each) for each in np.median(corners, axis=0))
    return MarkerSighting(
        id=sightings[0].id,
        pixel=_px(np.median(pixels, axis=0)),
        std_px=max(float(np.median([each.std_px for each in sightings])), scatter_px),
        corners=(first, second, third, fourth),
        corner_std_px=max(float(np.median([each.corner_std_px for each in sightings])), scatter_px),
    )


def _px(pixel: FloatArray) -> Px:
    return float(pixel[0]), float(pixel[1])


def _nothing(file: MarkersFile, first: NamedImage, count: int) -> NotDetermined:
    """Why no marker can be used, and what to try."""
    height_px, width_px = first.pixels.shape[:2]
    more = f" and {count - 1} more" if count > 1 else ""
    return NotDetermined(
        "no surveyed marker is seen",
        where=first.name + more,
        got=f"{width_px} x {height_px} px without one that stays in its place",
        expected=f"{file.dictionary} markers, {_ids(file.survey.by_id)}",
        hint=_suggestion(file, first.pixels),
    )


def _suggestion(file: MarkersFile, pixels: ImageArray) -> str:
    other = other_dictionary(pixels, file.survey.dictionary).lower()
    if other:
        return f"markers of {other} are there: is that the dictionary?"
    return f"are they at least {MIN_SIDE_PX} px wide, sharp, whole, and with a white margin?"


def _notes(unseen: Sequence[int], moved: dict[int, float], together: _Sightings, judgement: Judgement) -> Iterator[str]:
    if unseen:
        yield f"{_ids(unseen)} {'is' if len(unseen) == 1 else 'are'} surveyed, but not seen"
    for marker, px in sorted(moved.items()):
        yield f"marker {marker} moves by {px:.0f} px between the images, left out"
    for marker, why in sorted(judgement.false.items()):
        yield f"marker {marker} at {_at(together[marker].pixel)} cannot be true: {why}, left out"
    if not judgement.is_checked:
        yield "there is no evidence to spare: a false marker would not be noticed, add a marker or a prior"
    if judgement.misses:
        yield _missed(judgement.misses)


def _missed(misses: Sequence[Miss]) -> str:
    worst = max(misses, key=lambda each: each.away_m)
    rms_m = math.sqrt(sum(each.away_m**2 for each in misses) / len(misses))
    rms_px = math.sqrt(sum(each.px**2 for each in misses) / len(misses))
    return (
        f"a pose without it misses a marker's centre by {rms_m:.3f} m ({rms_px:.1f} px, root mean square of"
        f" {len(misses)}), at most {worst.away_m:.3f} m, of {marker_name(worst.id)}"
    )


def _ids(markers: Collection[int]) -> str:
    ids = [str(each) for each in sorted(markers)]
    return f"id {ids[0]}" if len(ids) == 1 else f"ids {', '.join(ids[:-1])} and {ids[-1]}"


def _at(pixel: Px) -> str:
    return f"[{pixel[0]:.0f}, {pixel[1]:.0f}]"
