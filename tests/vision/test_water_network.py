"""A user's own network in place of the segmentation: an ONNX file written here, byte by byte."""

import struct

import numpy as np
import pytest

from aerodft.dft import Setup
from aerodft.errors import InputError
from aerodft.vision.river import River, RiverQuestion, WaterNetwork, find_river
from tests.vision.river_scenes import picture, river_scene, true_crossing

BLUER_THAN_GREEN = (0.0, -40.0, 40.0)


def varint(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def number(field, value):
    return varint(field << 3) + varint(value)


def message(field, *parts):
    body = b"".join(part.encode() if isinstance(part, str) else part for part in parts)
    return varint(field << 3 | 2) + varint(len(body)) + body


def value_info(field, name, *sides):
    shape = message(2, *(message(1, number(1, side)) for side in sides))
    return message(field, message(1, name), message(2, message(1, number(1, 1), shape)))


def convolution(weights):
    """An ONNX model: one 1 x 1 convolution of red, green and blue to a logit."""
    tensor = [number(1, side) for side in (1, 3, 1, 1)]
    tensor += [number(2, 1), message(8, "w"), message(9, struct.pack("<3f", *weights))]
    kernel = message(5, message(1, "kernel_shape"), number(8, 1), number(8, 1), number(20, 7))
    node = message(1, message(1, "x"), message(1, "w"), message(2, "y"), message(4, "Conv"), kernel)
    graph = [node, message(2, "water"), message(5, *tensor)]
    graph += [value_info(11, "x", 1, 3, 288, 480), value_info(12, "y", 1, 1, 288, 480)]
    return number(1, 8) + message(7, *graph) + message(8, number(2, 13))


def test_widths_with_a_network(tmp_path):
    path = tmp_path / "blue.onnx"
    path.write_bytes(convolution(BLUER_THAN_GREEN))
    scene = river_scene("curved", 20, 1)
    camera, image = picture(scene)
    question = RiverQuestion(spacing_m=2.0, network=WaterNetwork.read(path))
    found = find_river(image, Setup(camera=camera), scene.pose, question)
    assert isinstance(found, River)
    rows = found.rows
    crossing = true_crossing(scene.world.river, found.transects.centres_en_m[rows], found.transects.to_left[rows])
    np.testing.assert_allclose(found.widths.width_m, crossing[:, 0] - crossing[:, 1], rtol=0.01)


@pytest.mark.parametrize("content", [b"", b"not a network", convolution(BLUER_THAN_GREEN)[:40]])
def test_what_is_no_network_is_one_sentence(tmp_path, content):
    path = tmp_path / "broken.onnx"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"broken.onnx"):
        WaterNetwork.read(path)


def test_a_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        WaterNetwork.read(tmp_path / "none.onnx")
