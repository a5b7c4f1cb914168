"""Every kind of probe through every door: Python, ``--probe``, a station's file, a request on the bus, a page's query.

The doors lead to one engine: the same question has the same bytes for an answer, whoever asks.
"""

import math
from dataclasses import replace

import cv2
import numpy as np
import orjson
import pytest
import tomli_w

import aerodft as ad
from aerodft.adapters.bus import session_on
from aerodft.adapters.config.station import parse_station, resolved_toml
from aerodft.adapters.wire.requests import parse_measure_request
from aerodft.app.measure import MeasuredSurface, image_setup, measured_document
from aerodft.app.viewing import FixedCameraView, probe_of
from aerodft.cli.scenes.image_options import Stds, parse_probes
from aerodft.dft import PROBE_KINDS, probe_end
from aerodft.errors import AerodftError
from aerodft.model import KnownPoint
from aerodft.web.answers import Answers
from replay.recordings import Recording
from tests.commands import run_aerodft
from tests.ports import free_endpoint

CAMERA = {"name": "yard", "width_px": 1920, "height_px": 1080, "hfov_deg": 60.0}
POSE = {"height_m": 12.0, "tilt_deg": 35.0, "heading_deg": 20.0}
STD = {"height_m": 1e-3, "tilt_deg": 2e-3, "pan_deg": 2e-3, "roll_deg": 2e-3, "position_m": 0.0, "heading_deg": 0.5}
NOISE_PX, VERTICES, LINES, REPEATS = 1.5, 41, 12, 200
OF_THE_DOOR = ("name", "stamp_ns", "image", "config", "pose", "budget", "advice", "command", "geojson")
"""Keys of a measurement that say where and when it was asked for."""
STATES_STDS = ("std stated", "std of", "taken as exact", "assumed")


def noisy_lines(rng):
    """A curved line of 40 segments, and the line with noise, ``REPEATS`` times."""
    along = np.linspace(300, 1600, VERTICES)
    line = np.stack([along, 560 + 180 * np.sin(along / 260)], axis=-1)
    return line, [line + NOISE_PX * rng.standard_normal(line.shape) for _ in range(REPEATS)]


LINE, NOISY = noisy_lines(np.random.default_rng(38))
PIXELS = {
    "position": [[700, 500]],
    "range": [[700, 500]],
    "distance": [[400, 300], [1500, 420]],
    "width": [[600, 700], [660, 702]],
    "length": [[400, 300], [900, 350], [1500, 420]],
    "area": [[400, 300], [1500, 320], [1400, 900], [380, 850]],
    "height": [[820, 640], [822, 560]],
    "bearing": [[1000, 500]],
    "river": [[300, 700], [900, 690], [310, 500], [880, 490], [330, 300], [870, 310]],
}
HEIGHTS = {"elevation_m": [0.027, 0.48], "elevation_std_m": [0.02, 0.03]}
POINTS = {
    "A": {"pixel": (400.0, 300.0), "elevation_m": 0.027, "elevation_std_m": 0.02},
    "B": {"pixel": (1500.0, 420.0), "elevation_m": 0.48, "elevation_std_m": 0.03},
}
SURVEYED = [
    ({"kind": "distance", "pixels": ["@A", "@B"]}, {"pixels": PIXELS["distance"], **HEIGHTS}),
    (
        {"kind": "width", "pixels": [[600, 700], "660,702@B"], "elevation_m": 0.1, "elevation_std_m": 0.01},
        {"pixels": PIXELS["width"], "elevation_m": [0.1, 0.48], "elevation_std_m": [0.01, 0.03]},
    ),
    (
        {"kind": "area", "pixels": ["@A", [1500, 320], [1400, 900], "380,850@B"], "elevation_m": [0.5, 1.0]},
        {
            "pixels": PIXELS["area"],
            "elevation_m": [0.027, 0.5, 1.0, 0.48],
            "elevation_std_m": [0.02, 0.0, 0.0, 0.03],
        },
    ),
    (
        {"kind": "height", "pixels": ["820,640@A", "822,560@B"]},
        {"pixels": PIXELS["height"], "elevation_m": [0.027], "elevation_std_m": [0.02]},
    ),
    ({"kind": "bearing", "pixels": ["1000,500@A"]}, {"pixels": PIXELS["bearing"]}),
]
"""Probes of surveyed points, and what they are where pixels and heights are typed out."""
PROBES = [
    *(each for each, _ in SURVEYED),
    *({"kind": kind, "pixels": pixels} for kind, pixels in PIXELS.items()),
    {"kind": "bearing", "pixels": [[500, 800], [900, 300]]},
    {"kind": "distance", "pixels": PIXELS["distance"], "elevation_m": 0.3, "elevation_std_m": 0.05},
    {"kind": "distance", "pixels": PIXELS["distance"], **HEIGHTS},
    {"kind": "width", "pixels": PIXELS["width"], "elevation_m": [0.1, 0.0], "elevation_std_m": 0.01},
    {"kind": "bearing", "pixels": [[500, 800], [900, 300]], **HEIGHTS},
    {"kind": "length", "pixels": PIXELS["length"], "elevation_m": [0.0, 0.5, 1.0], "elevation_std_m": [0.1, 0.0, 0.02]},
    {"kind": "area", "pixels": PIXELS["area"], "elevation_m": [0.0, 0.5, 1.0, 0.2], "elevation_std_m": 0.02},
    {"kind": "river", "pixels": PIXELS["river"], **HEIGHTS},
    {"kind": "river", "pixels": PIXELS["river"], "elevation_m": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]},
    *({"kind": "length", "pixels": np.round(line, 6).tolist()} for line in NOISY[:LINES]),
]


def test_every_kind_is_asked_for():
    assert set(PIXELS) == set(PROBE_KINDS)


def name_of(number):
    return f"probe-{number}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("doors")
    (made / "camera.toml").write_text(tomli_w.dumps(CAMERA))
    return made


@pytest.fixture(scope="module")
def by_python(folder):
    points = {name: KnownPoint(**each) for name, each in POINTS.items()}
    probes = [
        ad.probe(**{**each, "pixels": [probe_end(end, points) for end in each["pixels"]]}, std_px=NOISE_PX)
        for each in PROBES
    ]
    pose = ad.CameraPose(**POSE, std=ad.PoseStd(**STD))
    found = ad.measure(ad.load_camera(folder / "camera.toml"), pose, probes)
    return [measured_document(each, None) for each in found]


def typed(probe):
    """A probe as it is typed after ``--probe``."""
    words = [probe["kind"], *(end if isinstance(end, str) else f"{end[0]!r},{end[1]!r}" for end in probe["pixels"])]
    for key, value in probe.items():
        if key.startswith("elevation"):
            words.append(
                f"{key.removesuffix('_m')}={','.join(map(repr, value if isinstance(value, list) else [value]))}"
            )
    return " ".join(words)


def by_command(folder):
    stds = ",".join(f"{name.rpartition('_')[0]}={std}" for name, std in STD.items())
    pose = [word for name, value in POSE.items() for word in (f"--{name.rpartition('_')[0]}", value)]
    landmarks = [
        {"name": name, "pixel": each["pixel"], "position_m": [1.0, 2.0, each["elevation_m"]],
         "std_m": [0.0, 0.0, each["elevation_std_m"]]}
        for name, each in POINTS.items()
    ]  # fmt: skip
    (folder / "landmarks.toml").write_text(tomli_w.dumps({"crs": "local", "elevation_m": 0.0, "landmark": landmarks}))
    run = run_aerodft(
        "measure", "--camera", folder / "camera.toml", *pose, "--std", f"{stds},px={NOISE_PX}",
        "--landmarks", folder / "landmarks.toml",
        *(word for each in PROBES for word in ("--probe", typed(each))), "--json",
    )  # fmt: skip
    assert run.code == 0, run.err
    return orjson.loads(run.out)


def station_document(endpoint):
    std = {"horizontal_m" if name == "position_m" else name: value for name, value in STD.items()}
    probes = [{"name": name_of(number), "std_px": NOISE_PX, **each} for number, each in enumerate(PROBES)]
    pose = {"height_agl_m": POSE["height_m"], "tilt_deg": POSE["tilt_deg"], "heading_deg": POSE["heading_deg"]}
    return {
        "station": {"name": "yard"},
        "camera": CAMERA,
        "pose": pose | {"std": std},
        "images": {"rate_hz": 1},
        "zenoh": {"listen": endpoint},
        "known_point": [{"name": name, **each} for name, each in POINTS.items()],
        "probe": probes,
    }


def asked_on_bus(session, question):
    (reply,) = session.get("aerodft/yard/measure", payload=orjson.dumps(question), timeout=60.0)
    assert reply.ok is not None, reply.err.payload.to_string()
    return orjson.loads(reply.ok.payload.to_bytes())[0]


@pytest.fixture(scope="module")
def by_station(folder):
    """The configured probes of one image, and the replies to the same questions on the bus."""
    endpoint, first = free_endpoint(), {}
    (folder / "station.toml").write_text(tomli_w.dumps(station_document(endpoint)))
    station = ad.Station(folder / "station.toml", output=folder / "recording")
    with station:
        station.wait(seconds=0.1)
        with session_on(None, [endpoint]) as session:
            replies = [asked_on_bus(session, {**each, "std_px": NOISE_PX}) for each in PROBES]
        while not station.result or not station.result.statistics.images:
            station.wait(seconds=0.1)
    for payload in Recording(folder / "recording").measurements():
        measured = orjson.loads(payload)
        first.setdefault(measured["name"], measured)
    return [first[name_of(number)] for number in range(len(PROBES))], replies


def by_page(folder):
    camera, std = ad.load_camera(folder / "camera.toml"), ad.PoseStd(**STD)
    setup, sample = image_setup(camera, ad.CameraPose(**POSE, std=std))
    scene = replace(setup, points={name: KnownPoint(**each) for name, each in POINTS.items()}), sample
    view = FixedCameraView(folder / "yard.png", camera, scene, {}, MeasuredSurface())
    view.std_px = NOISE_PX
    answers = Answers(view, is_read_only=True)
    found = []
    for first in range(0, len(PROBES), 32):
        question = orjson.dumps({"image": 0, "probes": PROBES[first : first + 32]})
        found += answers.answer(answers.question(question))["measurements"]
    return found


def answer_bytes(measurement):
    """What a measurement answers, without what differs by the door through which it was asked for."""
    kept = {key: value for key, value in measurement.items() if key not in OF_THE_DOOR}
    reasons = [each for each in measurement["reasons"] if not each.startswith(STATES_STDS)]
    return orjson.dumps(kept | {"reasons": reasons})


def test_every_door_gives_the_same_bytes(folder, by_python, by_station):
    cv2.imwrite(str(folder / "yard.png"), np.zeros((1080, 1920, 3), dtype=np.uint8))
    configured, replies = by_station
    doors = {"command": by_command(folder), "station": configured, "bus": replies, "page": by_page(folder)}
    for door, answers in doors.items():
        assert len(answers) == len(PROBES)
        for probe, expected, answer in zip(PROBES, by_python, answers, strict=True):
            assert answer_bytes(answer) == answer_bytes(expected), (door, probe)
    for probe, answer in zip(PROBES[len(SURVEYED) :], doors["page"][len(SURVEYED) :], strict=True):
        assert all(word in answer["command"] for word in typed(probe).split() if word.startswith("elevation"))
    assert {each["status"] for each in by_python} == {"ok"}


def test_surveyed_points_are_measured_at_their_own_heights(folder, by_python):
    typed_out = [ad.probe(probe["kind"], **stated, std_px=NOISE_PX) for probe, stated in SURVEYED]
    pose = ad.CameraPose(**POSE, std=ad.PoseStd(**STD))
    found = ad.measure(ad.load_camera(folder / "camera.toml"), pose, typed_out)
    for surveyed, stated in zip(by_python[: len(SURVEYED)], found, strict=True):
        assert answer_bytes(surveyed) == answer_bytes(measured_document(stated, None))


@pytest.mark.parametrize(
    ("pixels", "more", "said"),
    [
        (["@A", "@C"], {}, "got @C, expected one of A, B"),
        (["@A", "1,2,3"], {}, "1,2,3"),
        (["@A", "1,nan@B"], {}, "'nan', expected a finite number"),
        (
            ["@A", [900, 900]],
            {"elevation_m": [0.1, 0.2]},
            "got 2 elevations beside 1 surveyed point, expected one",
        ),
        (["@A"], {}, "got 1 pixel, expected 2"),
    ],
)
def test_a_surveyed_point_that_nobody_knows_is_refused_at_each_door(folder, pixels, more, said):
    points = {name: KnownPoint(**each) for name, each in POINTS.items()}
    document = station_document("tcp/127.0.0.1:1")
    document["probe"] = [{"name": "d", "kind": "distance", "pixels": pixels, **more}]
    question = {"kind": "distance", "pixels": pixels, **more}
    doors = (
        lambda: parse_station(tomli_w.dumps(document).encode(), where="station.toml", folder=folder),
        lambda: parse_measure_request(orjson.dumps(question), points),
        lambda: probe_of(question, 1.0, lambda: points),
        lambda: parse_probes([typed(question)], Stds(), 0.0, points),
    )
    for door in doors:
        with pytest.raises(AerodftError) as refused:
            door()
        assert said in str(refused.value), door


@pytest.mark.parametrize("pixels", [None, 5, ["@A", "@B"], [KnownPoint(**POINTS["A"]), None], [(1, 2), (3, math.nan)]])
def test_what_are_no_ends_is_misuse_in_python(pixels):
    with pytest.raises(ad.UsageError, match=r"a width: .*expected pixels \(u, v\) of finite numbers"):
        ad.Width(pixels)


def test_heights_of_surveyed_points_count_over_level_ground_alone(folder):
    points = {name: KnownPoint(**each) for name, each in POINTS.items()}
    camera, pose = ad.load_camera(folder / "camera.toml"), ad.CameraPose(**POSE)
    slope = ad.Slope(slope_deg=5.0, uphill_deg=20.0)
    with pytest.raises(ad.AerodftError, match="got ground that is not level"):
        ad.measure(camera, pose, ad.Distance([points["A"], points["B"]]), ground=slope)
    document = station_document("tcp/127.0.0.1:1") | {"ground": {"slope_deg": 5.0, "uphill_azimuth_deg": 20.0}}
    with pytest.raises(AerodftError, match="no surveyed point has a height above the measured plane, expected level"):
        parse_station(tomli_w.dumps(document).encode(), where="station.toml", folder=folder)
    document["probe"] = []
    station = parse_station(tomli_w.dumps(document).encode(), where="station.toml", folder=folder)
    assert (len(station.pipeline.points), station.pipeline.setup.points) == (2, {})
    assert parse_station(resolved_toml(station).encode(), where="", folder=folder).pipeline.points == points


def on_planes_m(pixels, elevation_m):
    """Right and ahead ``(k, 2)`` of pixels on level planes, by the pinhole's closed form."""
    focal_px = CAMERA["width_px"] / 2 / math.tan(math.radians(CAMERA["hfov_deg"]) / 2)
    x, y = ((np.asarray(pixels) - [959.5, 539.5]) / focal_px).T
    tilt = math.radians(POSE["tilt_deg"])
    down, ahead = math.cos(tilt) + y * math.sin(tilt), math.sin(tilt) - y * math.cos(tilt)
    return ((POSE["height_m"] - np.asarray(elevation_m)) / down)[:, None] * np.stack([x, ahead], axis=-1)


def length_m(points_m):
    return float(np.sum(np.hypot(*np.diff(points_m, axis=0).T)))


def area_m2(points_m):
    (x, y), (x1, y1) = points_m.T, np.roll(points_m, -1, axis=0).T
    return abs(float(np.sum(x * y1 - x1 * y))) / 2


def test_points_at_different_heights_are_each_on_their_own_plane(by_python):
    truths = {
        "distance": length_m,
        "width": length_m,
        "length": length_m,
        "area": area_m2,
        "river": lambda points_m: float(np.median([length_m(points_m[k : k + 2]) for k in range(0, len(points_m), 2)])),
    }
    checked = 0
    for probe, measured in zip(PROBES[len(SURVEYED) :], by_python[len(SURVEYED) :], strict=True):
        heights_m, count = probe.get("elevation_m"), len(probe["pixels"])
        if isinstance(heights_m, list) and probe["kind"] in truths:
            points_m = on_planes_m(probe["pixels"], np.resize(heights_m, count))
            assert measured["value"] == pytest.approx(truths[probe["kind"]](points_m), rel=1e-9)
            assert [z for *_, z in measured["ground_m"]] == np.resize(heights_m, count).tolist()
            checked += 1
    assert checked == 6


def test_lines_of_many_noisy_vertices_are_as_long_as_they_are(folder, by_python):
    """What holds for Python's door holds for each, by the test above."""
    probes = [ad.probe("length", np.round(line, 6), std_px=NOISE_PX) for line in NOISY]
    pose = ad.CameraPose(**POSE, std=ad.PoseStd(**STD))
    found = ad.measure(ad.load_camera(folder / "camera.toml"), pose, probes)
    assert [each.value for each in found[:LINES]] == [each["value"] for each in by_python[-LINES:]]
    truth_m = length_m(on_planes_m(LINE, 0.0))
    held = [each.ci95[0] <= truth_m <= each.ci95[1] for each in found]
    assert 0.92 <= np.mean(held) <= 0.985
    assert abs(np.mean([each.value for each in found]) - truth_m) < 0.2 * found[0].std
