"""From pictures of surveyed markers, through a bent lens, to evidence and a pose whose truth is known."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from aerodft.adapters.config.camera import load_camera
from aerodft.app.calibrate import detected_evidence
from aerodft.errors import AerodftError, InputError, NoAnswerError, UsageError
from calibration.lens import dictionary_names
from calibration.markers import find_markers, judge
from calibration.pose import calibrate

from ..calibration.marker_pictures import (  # noqa: TID252 - test folders are no packages that could be named
    STOP,
    Lens,
    View,
    flat,
    picture,
    upright,
)

LENS = Lens()
VIEW = View(LENS, (2.0, -1.0, 6.0), tilt_deg=55.0, heading_deg=20.0)
POSE = ("position", "height", "tilt", "roll", "heading")
MARKERS = (
    flat(0, (2.0, 4.2, 0.0), 20.0, side=0.5),
    flat(1, (6.5, 6.0, 0.1), 130.0, side=0.5),
    upright(2, (0.5, 9.5, 1.2), 190.0, side=0.5),
    upright(3, (5.0, 12.0, 0.6), 220.0, side=0.6),
    flat(4, (3.6, 7.0, 0.3), 290.0, side=0.5),
    upright(5, (9.5, 9.5, 2.0), 240.0, side=0.6),
)
CAMERA = f"""
name = "scene"
width_px = {LENS.width}
height_px = {LENS.height}
fx_px = {LENS.focal[0]}
fy_px = {LENS.focal[1]}
cx_px = {LENS.centre[0]}
cy_px = {LENS.centre[1]}
distortion = {list(LENS.distortion)}
"""
HALL = Path(__file__).parents[3] / "shared" / "data" / "landmarks" / "markers"


def file_of(markers, head="", *, corners=(), sides=()):
    text = ['dictionary = "4x4_50"', head]
    for each in markers:
        text += ["[[marker]]", f"id = {each.id}", "std_m = 0.0"]
        place = f"corners_m = {each.corners.tolist()}" if each.id in corners else f"position_m = {list(each.centre)}"
        text += [place, *([f"side_m = {each.side}"] if each.id in sides else [])]
    return "\n".join(text)


class Scene:
    """A folder with a camera file, to which files of markers and pictures are added."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "camera.toml").write_text(CAMERA)
        self.camera = load_camera(folder / "camera.toml")

    def markers(self, text):
        path = self.folder / "markers.toml"
        path.write_text(text)
        return path

    def image(self, pixels, name="view.png"):
        path = self.folder / name
        cv2.imwrite(str(path), pixels)
        return path

    def detected(self, text, *images, names=POSE):
        return detected_evidence(self.markers(text), list(images), self.camera, names)


@pytest.fixture
def scene(tmp_path):
    return Scene(tmp_path)


@pytest.fixture(scope="module")
def pixels():
    return picture(VIEW, MARKERS)


def z_scores(found, camera, names=POSE):
    """How many stated stds the pose is off: east, north, height, tilt, roll, heading."""
    result = calibrate(found.known, camera, names)
    assert result.weakest.is_determined
    state, order = result.solution.state, result.problem.unknowns.names
    truth = dict(
        zip(
            ("east", "north", "height", "tilt", "roll", "heading"),
            (*VIEW.place, np.radians(VIEW.tilt_deg), 0.0, np.radians(VIEW.heading_deg)),
            strict=True,
        )
    )
    stds = np.sqrt(np.diag(result.solution.covariance))
    return {
        name: (state.value(name) - truth[name]) / std for name, std in zip(order, stds, strict=True) if name in truth
    }


@pytest.mark.parametrize("corners", [(), (0, 3), range(6)])
def test_the_pose_is_as_good_as_it_says(scene, pixels, corners):
    found = scene.detected(file_of(MARKERS, corners=corners), scene.image(pixels))
    assert len(found.known.evidence) == 6 + 3 * len(corners)
    scores = z_scores(found, scene.camera)
    assert len(scores) == 6
    assert max(map(abs, scores.values())) < 3


def test_what_else_the_file_knows_counts_too(scene, pixels):
    head = "[camera]\nposition_m = [2.0, -1.0]\nroll_deg = { value = 0.0, std = 0.5 }\nheading_deg = 20.0"
    two = [f"[[marker]]\nid = {each.id}\nstd_m = 0.0\nposition_m = {list(each.centre)}" for each in MARKERS]
    text = "\n".join(['dictionary = "4x4_50"', head, *two])
    found = scene.detected(text, scene.image(pixels), names=("height", "tilt"))
    scores = z_scores(found, scene.camera, ("height", "tilt"))
    assert set(scores) == {"height", "tilt", "roll"}
    assert max(map(abs, scores.values())) < 3


@pytest.mark.parametrize("corners", [(), range(6)])
def test_a_marker_in_another_place_is_rejected_and_named(scene, pixels, corners):
    decoy = replace(MARKERS[4], centre=(4.6, 6.4, 0.3))
    surveyed = [decoy if each.id == decoy.id else each for each in MARKERS]
    found = scene.detected(file_of(surveyed, corners=corners), scene.image(pixels))
    names = {each.name for each in found.known.evidence}
    assert {name.split()[0] for name in names} == {f"marker-{each}" for each in (0, 1, 2, 3, 5)}
    (note,) = [each for each in found.notes if "cannot be true" in each]
    off_px = np.linalg.norm(VIEW.pixels([decoy.centre])[0] - VIEW.pixels([MARKERS[4].centre])[0])
    assert note.startswith("marker 4 at ")
    assert float(re.search(r"it is (\d+) px from", note)[1]) == pytest.approx(off_px, abs=3)
    assert len(found.stated) == len(found.known.evidence)
    assert max(map(abs, z_scores(found, scene.camera).values())) < 3


def test_a_marker_of_another_size_is_rejected_and_named(scene, pixels):
    decoy = replace(MARKERS[2], side=0.9)
    text = file_of([*MARKERS[:2], decoy, MARKERS[3], MARKERS[4], MARKERS[5]], sides=range(6))
    found = scene.detected(text, scene.image(pixels))
    (note,) = [each for each in found.notes if "cannot be true" in each]
    assert note.startswith("marker 2 at ")
    assert float(re.search(r"looks ([\d.]+) m wide", note)[1]) == pytest.approx(0.5, rel=0.05)


def test_sizes_that_are_true_are_believed_from_any_side(scene, pixels):
    found = scene.detected(file_of(MARKERS, sides=range(6)), scene.image(pixels))
    assert not [each for each in found.notes if "cannot be true" in each]


def test_sides_in_another_unit_are_noticed(scene, pixels):
    feet = [replace(each, side=each.side / 0.3048) for each in MARKERS]
    with pytest.raises(NoAnswerError, match=r"they look 0\.3 times as large as side_m") as refused:
        scene.detected(file_of(feet, sides=range(6)), scene.image(pixels))
    assert refused.value.exit_code == 4


def test_too_few_markers_to_tell_which_one_is_false_are_refused(scene, pixels):
    surveyed = [*MARKERS[:3], replace(MARKERS[4], centre=(4.6, 6.4, 0.3))]
    with pytest.raises(NoAnswerError, match="ids 0, 1, 2 and 4: no camera explains them all") as refused:
        scene.detected(file_of(surveyed, "ignore = [3, 5]"), scene.image(pixels))
    assert refused.value.exit_code == 4


def test_one_marker_with_its_corners_is_enough(scene, pixels):
    found = scene.detected(file_of(MARKERS[:1], "ignore = [1, 2, 3, 4, 5]", corners=[0]), scene.image(pixels))
    assert len(found.known.evidence) == 4
    assert not [each for each in found.notes if "misses" in each]
    assert max(map(abs, z_scores(found, scene.camera).values())) < 4


def test_held_out_errors_are_those_of_opencv(scene, pixels):
    found = scene.detected(file_of(MARKERS), scene.image(pixels))
    seen = {each.id: each for each in find_markers(pixels, _survey(scene), scene.camera)}
    judgement = judge(found.known, seen, {}, partial(calibrate, camera=scene.camera, names=POSE))
    points = np.array([each.centre for each in MARKERS])
    measured = np.array([seen[each.id].pixel for each in MARKERS])
    ideal = cv2.undistortPoints(measured[:, None], LENS.matrix, np.array(LENS.distortion), criteria=STOP)[:, 0]
    expected = []
    for index in range(len(MARKERS)):
        rest = np.arange(len(MARKERS)) != index
        start = cv2.Rodrigues(VIEW.rotation)[0], -VIEW.rotation @ np.array(VIEW.place)
        _, turn, shift = cv2.solvePnP(points[rest], ideal[rest], np.eye(3), None, *start, useExtrinsicGuess=True)
        seen_at = cv2.projectPoints(points[index : index + 1], turn, shift, LENS.matrix, np.array(LENS.distortion))[0]
        expected.append(np.linalg.norm(seen_at[0, 0] - measured[index]))
    np.testing.assert_allclose([each.px for each in judgement.misses], expected, atol=0.03)
    rms = np.sqrt(np.mean(np.square(expected)))
    (note,) = [each for each in found.notes if "misses" in each]
    assert float(re.search(r"\(([\d.]+) px", note)[1]) == pytest.approx(rms, abs=0.1)
    for miss, marker in zip(judgement.misses, MARKERS, strict=True):
        distance = np.linalg.norm(np.array(marker.centre) - VIEW.place)
        assert miss.away_m == pytest.approx(miss.px * distance / LENS.focal[0], rel=0.35)


def _survey(scene):
    from aerodft.adapters.config.evidence import load_markers  # noqa: PLC0415 - only here

    return load_markers(scene.folder / "markers.toml").survey


def test_without_evidence_to_spare_it_says_that_nothing_was_checked(scene, pixels):
    found = scene.detected(file_of(MARKERS[:3], "ignore = [3, 4, 5]"), scene.image(pixels))
    assert any("would not be noticed" in each for each in found.notes)


def test_several_images_of_one_view_are_one_observation(scene):
    images = [scene.image(picture(VIEW, MARKERS, seed=seed, noise=8.0), f"view{seed}.png") for seed in range(4)]
    found = scene.detected(file_of(MARKERS), *images)
    assert len(found.known.evidence) == 6
    truth = VIEW.pixels([each.centre for each in MARKERS])
    np.testing.assert_allclose([each.pixel for each in found.known.evidence], truth, atol=0.2)
    assert found.image == "view0.png"


def test_a_marker_that_moves_between_images_is_left_out(scene, pixels):
    moved = [replace(each, centre=(0.9, 8.8, 1.2)) if each.id == 2 else each for each in MARKERS]
    others = [scene.image(picture(VIEW, moved, seed=9), "other.png")]
    found = scene.detected(file_of(MARKERS), scene.image(pixels), *others)
    assert any(each.startswith("marker 2 moves by ") for each in found.notes)
    assert "marker-2" not in {each.name for each in found.known.evidence}


def test_a_camera_that_moves_between_images_is_refused(scene, pixels):
    other = scene.image(picture(replace(VIEW, heading_deg=21.0), MARKERS), "other.png")
    with pytest.raises(InputError, match="the camera moved between the images") as refused:
        scene.detected(file_of(MARKERS), scene.image(pixels), other)
    assert refused.value.exit_code == 3


def test_markers_that_are_not_seen_are_named(scene, pixels):
    more = [*MARKERS, flat(7, (30.0, -40.0, 0.0)), flat(8, (31.0, -40.0, 0.0))]
    found = scene.detected(file_of(more), scene.image(pixels))
    assert "ids 7 and 8 are surveyed, but not seen" in found.notes


def test_a_marker_that_nobody_surveyed_is_refused_unless_it_is_to_be_ignored(scene, pixels):
    image = scene.image(pixels)
    with pytest.raises(InputError, match=r"view.png: marker 5 is not surveyed: .*ignore = \[5\]") as refused:
        scene.detected(file_of(MARKERS[:5]), image)
    assert refused.value.exit_code == 3
    found = scene.detected(file_of(MARKERS[:5], "ignore = [5]"), image)
    assert {each.name for each in found.known.evidence} == {f"marker-{each}" for each in range(5)}


def test_a_marker_that_is_there_twice_is_refused(scene):
    image = scene.image(picture(VIEW, [*MARKERS, replace(MARKERS[0], centre=(5.0, 4.5, 0.0))]))
    with pytest.raises(InputError, match="marker 0 is there twice: got it at ") as refused:
        scene.detected(file_of(MARKERS), image)
    assert refused.value.exit_code == 3


def test_an_image_without_markers_says_what_was_looked_for(scene):
    image = scene.image(picture(VIEW, []))
    with pytest.raises(NoAnswerError) as refused:
        scene.detected(file_of(MARKERS[:2]), image)
    assert refused.value.exit_code == 4
    for word in ("view.png", "1280 x 720 px", "4x4_50", "ids 0 and 1", "white margin"):
        assert word in str(refused.value)


def test_another_dictionary_is_suggested(scene):
    image = scene.image(picture(VIEW, MARKERS, "APRILTAG_36h11"))
    with pytest.raises(NoAnswerError, match="markers of apriltag_36h11 are there: is that the dictionary"):
        scene.detected(file_of(MARKERS), image)
    assert "APRILTAG_36h11" in dictionary_names()


@pytest.mark.parametrize(
    ("make", "words", "code"),
    [
        (lambda scene: scene.image(np.zeros((720, 720, 3), np.uint8)), ["720 x 720 px", "1280 x 720 px"], 3),
        (lambda scene: scene.folder / "none.png", ["none.png", "no such file"], 3),
        (lambda scene: scene.markers("no image") and _renamed(scene), ["broken.png"], 3),
    ],
)
def test_images_that_cannot_be_used_are_named(scene, make, words, code):
    image = make(scene)
    with pytest.raises(AerodftError) as refused:
        scene.detected(file_of(MARKERS), image)
    assert refused.value.exit_code == code
    assert "\n" not in str(refused.value)
    for word in words:
        assert word in str(refused.value)


def _renamed(scene):
    path = scene.folder / "broken.png"
    path.write_bytes(b"this is text")
    return path


def test_no_images_and_no_such_unknown_are_misuse(scene, pixels):
    with pytest.raises(UsageError, match="`images`: got none"):
        scene.detected(file_of(MARKERS))
    with pytest.raises(UsageError, match="`unknowns`: got zoom"):
        scene.detected(file_of(MARKERS), scene.image(pixels), names=("zoom",))


@pytest.mark.skipif(not HALL.is_dir(), reason="the photo of the hall is not here")
def test_a_surveyed_hall_gives_a_pose_that_meets_centres_it_has_not_seen(scene):
    rows = [line.split() for line in (HALL / "aruco.txt").read_text().splitlines() if line.strip()]
    places = {int(marker): [float(each) for each in place] for marker, *place in rows}
    text = "\n".join(
        ['dictionary = "4x4_50"'] + [f"[[marker]]\nid = {each}\nposition_m = {at}" for each, at in places.items()]
    )
    focal = 27.0 / np.hypot(36.0, 24.0) * np.hypot(5664, 4248)  # of the photo's EXIF: equivalent to 27 mm
    size = "width_px = 5664\nheight_px = 4248\ncx_px = 2831.5\ncy_px = 2123.5"
    (scene.folder / "phone.toml").write_text(f'name = "phone"\n{size}\nfx_px = {focal}\nfy_px = {focal}')
    camera = load_camera(scene.folder / "phone.toml")
    (photo,) = HALL.glob("*.jpg")
    found = detected_evidence(scene.markers(text), [photo], camera, POSE)
    assert {each.name for each in found.known.evidence} == {f"marker-{each}" for each in (1, 3, 4, 5, 6)}
    assert "id 2 is surveyed, but not seen" in found.notes
    (note,) = [each for each in found.notes if "misses" in each]
    print(note)
    assert float(re.search(r"by ([\d.]+) m", note)[1]) < 0.03
    state = calibrate(found.known, camera, POSE).solution.state
    points = np.array([each.position_m for each in found.known.evidence])
    pixels_px = np.array([each.pixel for each in found.known.evidence])
    matrix = np.array([[focal, 0, 2831.5], [0, focal, 2123.5], [0, 0, 1]])
    _, turn, shift = cv2.solvePnP(points, pixels_px, matrix, None, flags=cv2.SOLVEPNP_SQPNP)
    by_opencv = (-cv2.Rodrigues(turn)[0].T @ shift).ravel()
    assert np.linalg.norm(state.position_m - by_opencv) < 0.05
