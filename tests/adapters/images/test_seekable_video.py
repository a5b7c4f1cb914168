"""Images of a video in any order are those that it gives from its start."""

import av
import numpy as np
import pytest

from aerodft.adapters.images import SeekableVideo, VideoFileSource

IMAGES = 90


@pytest.fixture(
    params=[("video.mp4", {"bf": "3", "g": "40"}), ("video.ts", {"bf": "2", "g": "60"}), ("video.mkv", {"g": "25"})]
)
def video(request, tmp_path):
    name, options = request.param
    with av.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream("libx264", rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for number in range(IMAGES):
            pixels = np.full((120, 160, 3), number, dtype=np.uint8)
            pixels[:, number : number + 20] = 255 - number
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode())
    return tmp_path / name


def test_images_in_any_order_are_those_from_the_start(video):
    expected = {image.index: image for image in VideoFileSource(video, start_ns=0).events()}
    found = SeekableVideo(video)
    assert len(found.media_ns) == len(expected) == IMAGES
    for number in [89, 0, 45, 46, 44, 10, 88, *np.random.default_rng(0).integers(0, IMAGES, 20).tolist()]:
        assert found.media_ns[number] == expected[number].stamp_ns
        np.testing.assert_array_equal(found.pixels(number), expected[number].pixels())
