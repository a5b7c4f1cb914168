"""Images from stills, folders and videos together: which ones, in which order, and what they are called."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from aerodft.adapters.images import named_images
from aerodft.adapters.images.image_sampling import MOST_OF_A_VIDEO
from aerodft.errors import InputError

NOISE = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)


def write_still(path, value):
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.full((48, 64, 3), value, np.uint8))
    return path


def write_video(path, images, fps):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


def test_folders_stills_and_videos_follow_each_other(tmp_path):
    folder = tmp_path / "photos"
    for name, value in (("b.png", 20), ("a.JPG", 10)):
        write_still(folder / name, value)
    (folder / "notes.txt").write_text("no picture")
    single = write_still(tmp_path / "z.png", 30)
    video = write_video(tmp_path / "v.mp4", [NOISE] * 3, 5)
    found = list(named_images([folder, single, video, single]))
    assert [image.name for image in found] == ["a.JPG", "b.png", "z.png", "v.mp4#0", "v.mp4#1", "v.mp4#2"]
    assert [int(image.pixels.mean()) for image in found[:3]] == [10, 20, 30]
    assert found[-1].done == 1.0
    assert [image.done for image in found] == sorted(image.done for image in found)


def test_files_of_one_name_are_told_apart(tmp_path):
    paths = [write_still(tmp_path / folder / "p.png", 40) for folder in ("a", "b")]
    assert [image.name for image in named_images(paths)] == [str(path) for path in paths]


def test_of_each_tenth_of_a_second_the_sharpest_image_is_taken(tmp_path):
    """At 30 images a second, every third one is sharp."""
    images = [NOISE if k % 3 == 1 else cv2.GaussianBlur(NOISE, (0, 0), 3) for k in range(30)]
    video = write_video(tmp_path / "v.mp4", images, 30)
    assert [int(image.name.partition("#")[2]) % 3 for image in named_images([video])] == [1] * 10


def test_a_long_video_is_sampled(tmp_path):
    video = write_video(tmp_path / "v.mp4", [NOISE] * 1500, 10)
    numbers = [int(image.name.partition("#")[2]) for image in named_images([video])]
    assert 0.9 * MOST_OF_A_VIDEO < len(numbers) <= MOST_OF_A_VIDEO + 1
    assert max(np.diff(numbers)) < 12


def test_what_is_missing_is_said_before_the_first_image(tmp_path):
    still = write_still(tmp_path / "a.png", 40)
    with pytest.raises(InputError, match=r"none\.png: no such file"):
        named_images([still, tmp_path / "none.png"])


def test_an_empty_file_is_named(tmp_path):
    (tmp_path / "a.png").touch()
    with pytest.raises(InputError, match=r"a\.png: not a readable image: got an empty file"):
        list(named_images([tmp_path / "a.png"]))
