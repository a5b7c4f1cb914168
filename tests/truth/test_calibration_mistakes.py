"""Evidence with a written mistake is never accepted with a wrong camera, nor blamed on another cause."""

import re

import numpy as np
import pytest

import aerodft as ad
from aerodft.errors import AerodftError
from tests.nights import at_night

from .mistaken_evidence import MISTAKES, drawn_scene

UNKNOWNS = ("position", "height", "tilt", "roll", "heading")
FULL_TURN = {"heading_deg", "roll_deg"}
SENTENCES = {
    "feet": "look like feet",
    "depths": "look like depths",
    "camera": "not of this camera's mode",
    "size": "look like those of an image of",
    "mirror": "mirror|u and v look inter|counted from the bottom|of the landmarks look inter|swap them: easting comes",
    "order": r"belonged to the|and landmark\[.*look interchanged",
    "prior": "contradicts the observations",
    "crs": "do not look like|look like those of a web map|look like degrees|look like lat",
    "landmark": "place: got|height: got|above the horizon|behind the camera",
}
"""What each cause is called by."""

OF_ONE = {"landmark", "order"}
CAUSES = {
    "feet": {"feet"}, "depths": {"depths"}, "focal": {"camera"}, "half": {"size"}, "mirrored": {"mirror"},
    "v up": {"mirror"}, "uv": {"mirror"}, "xy": {"mirror"}, "rows": {"order"}, "two swapped": {"order"},
    "shuffled": {"order"}, "1 m": OF_ONE, "10 m": OF_ONE, "100 m": OF_ONE, "digit u": OF_ONE, "digit v": OF_ONE,
    "digit x": OF_ONE, "digit y": OF_ONE, "digit z": OF_ONE,
}  # fmt: skip
"""The causes that may be named of a mistake; of the others none."""


def off_stds(document, truth):
    """Largest error of what was found, in its standard deviations."""
    errors = []
    for name, value in truth.items():
        found = document["parameters"][name]
        off = found["value"] - value
        errors.append(abs((off + 180) % 360 - 180 if name in FULL_TURN else off) / found["std"])
    return max(errors)


def refusal_of(evidence, folder, truth):
    """Why evidence is refused; empty where it is accepted with a camera that is where it was."""
    try:
        result = ad.calibrate(*evidence.write(folder), unknowns=UNKNOWNS)
    except AerodftError as error:
        return str(error)
    refusal = result.refusal()
    if refusal is not None:
        return str(refusal)
    assert off_stds(result.document(), truth) <= 5
    return ""


@pytest.mark.parametrize("seed", [1, *at_night(*range(2, 8))])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_or_refused(tmp_path, seed, mistake):
    scene = drawn_scene(seed)
    evidence = MISTAKES[mistake](scene.evidence, np.random.default_rng([3, seed]))
    refusal = refusal_of(evidence, tmp_path, scene.truth)
    named = {cause for cause, sentence in SENTENCES.items() if re.search(sentence, refusal)}
    assert not named or named & CAUSES.get(mistake, set()), refusal
    if mistake == "none":
        assert refusal == ""
