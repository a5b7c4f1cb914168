"""Rendered flights over surveyed markers, with telemetry that is wrong: what import and serve find and make of it."""

import math
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import orjson
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA, decode_image
from aerodft.model import BiasValues, StampClock
from aerodft.sim import default_camera
from aerodft.sim.scenario import survey_scenario, write_files
from replay.compare import compare_measurements
from replay.recordings import Recording
from tests.payloads import decode_observation
from tests.ports import free_endpoint, free_udp_port

from .conftest import run_aerodft
from .test_serve import PATIENCE_S, Service

HEIGHT_BIAS_M, TILT_BIAS_DEG = 1.5, 1.2
SETTLED_S = 2.0
START = "2026-11-21T00:34:38Z"
PROBES = [{"name": f"width-{each}", "kind": "distance", "observed": True} for each in "abc"]
ESTIMATE = "aerodft.calibration_estimate/1"


@pytest.fixture(scope="module")
def scenario():
    flight = survey_scenario(
        default_camera(960, 540), duration_s=5.0, fps=5.0
    )  # whole microseconds apart, as a video has them
    biases = BiasValues(height_m=HEIGHT_BIAS_M, tilt_rad=math.radians(TILT_BIAS_DEG))
    return replace(flight, autopilot=replace(flight.autopilot, biases=biases))


@pytest.fixture(scope="module")
def flight(scenario, tmp_path_factory):
    """The flight's files."""
    folder = tmp_path_factory.mktemp("marked")
    write_files(scenario, folder)
    return folder


def markers_of(world, *, corners=True, scale=1.0):
    """``[markers]`` with a simulated world's; ``scale`` of the sides that are stated."""
    rows = [
        {"id": each.id, "std_m": 0.01, "corners_m": each.corners_enu_m().tolist()}
        if corners
        else {"id": each.id, "position_m": each.centre_enu_m.tolist(), "side_m": scale * each.side_m}
        for each in world.markers
    ]
    return {"dictionary": "4x4_50", "marker": rows}


def write_station(path, world, **tables):
    origin = world.origin
    place = {
        "lat_deg": math.degrees(origin.lat_rad),
        "lon_deg": math.degrees(origin.lon_rad),
        "alt_msl_m": origin.alt_msl_m,
    }
    heights, attitude = {"order": ["home"], "std_m": {"home": 1.5}}, {"feedback": "measured", "frame": "earth"}
    telemetry = {"height": heights, "attitude": attitude, **tables.pop("telemetry", {})}
    document = {
        "station": {"name": "live", "origin": place},
        "camera": {"file": "camera.toml"},
        "telemetry": telemetry,
        "record": {"image_hz": 0.0},
        "probe": PROBES,
        **tables,
    }
    path.write_text(tomli_w.dumps(document))
    return path


def imported(flight, world, name, *more, **tables):
    config = write_station(flight / f"{name}.toml", world, **tables)
    run = run_aerodft(
        *("import", flight / "flight.tlog", "--video", flight / "video.mp4", "--video-start", START, "-c", config),
        *("-o", flight / name, "--json", *more),
    )
    assert run.code == 0, run.err
    return run


def raw(recording, schema):
    return [message.data for message in Recording(recording).messages() if message.channel.schema == schema]


def decoded(recording, schema):
    return list(map(orjson.loads, raw(recording, schema)))


def seen_in(recording):
    found = map(decode_observation, raw(recording, OBSERVATION_SCHEMA))
    return [each for each in found if each.source == "vision"]


def width_errors(flight, recording, since_s=0.0):
    """Relative errors and stds of all widths, against the simulator's truth."""
    lines = map(orjson.loads, (flight / "truth.jsonl").read_bytes().splitlines())
    truth = {(each["stamp_ns"], each["name"]): each["value"] for each in lines}
    got = [m for m in map(orjson.loads, Recording(recording).measurements()) if m["status"] == "ok"]
    start_ns = min(int(stamp) for stamp, _ in truth)
    late = [m for m in got if int(m["stamp_ns"]) >= start_ns + since_s * 1e9]
    known = np.array([truth[m["stamp_ns"], m["name"]] for m in late])
    return np.array([m["value"] for m in late]) / known - 1, np.array([m["std"] for m in late]) / known


@pytest.fixture(scope="module")
def refined(flight, scenario):
    """The flight imported with its markers: its recording and summary."""
    markers = markers_of(scenario.world)
    run = imported(flight, scenario.world, "refined", "--observations", flight / "observations.jsonl", markers=markers)
    return flight / "refined", run.json


def test_widths_lose_the_telemetrys_errors_and_state_what_is_left(flight, scenario, refined):
    imported(flight, scenario.world, "plain", "--observations", flight / "observations.jsonl")
    before, stated = width_errors(flight, flight / "plain", SETTLED_S)
    after, stds = width_errors(flight, refined[0], SETTLED_S)
    assert len(after) >= 10
    assert np.sqrt(np.mean(before**2)) > 0.03
    assert np.sqrt(np.mean(after**2)) < 0.01
    assert np.all(np.abs(after) < 4 * stds)
    assert np.median(stds) < 0.5 * np.median(stated)


def test_the_estimate_is_the_planted_error(refined):
    last = decoded(refined[0], ESTIMATE)[-1]
    for name, planted in (("height_m", -HEIGHT_BIAS_M), ("tilt_deg", -TILT_BIAS_DEG)):
        found = last["bias"][name]
        assert abs(found["value"] - planted) < 4 * found["std"]
        assert found["std"] < abs(planted) / 5
    assert refined[1]["landmarks"]["used"] == last["updates"] > 20


def test_what_was_seen_belongs_to_its_images_and_lies_where_the_truth_is(flight, refined):
    stamps = {each.index: each.stamp_ns for each in map(decode_image, raw(refined[0], IMAGE_SCHEMA))}
    seen = seen_in(refined[0])
    assert {each.image: each.stamp_ns for each in seen}.items() <= stamps.items()
    truth = {
        (int(each["stamp_ns"]), each["name"]): each["pixels"][0]
        for each in map(orjson.loads, (flight / "truth.jsonl").read_bytes().splitlines())
        if each["name"].startswith("marker-")
    }
    corners = {}
    for each in seen:
        corners.setdefault((each.stamp_ns, each.name.rsplit("-corner-", 1)[0]), []).append(each.pixels[0])
    known = [key for key in corners if key in truth]
    assert len(known) > 15
    centres = np.array([np.mean(corners[key], axis=0) for key in known])
    np.testing.assert_allclose(
        centres, np.array([truth[key] for key in known]), atol=1.0
    )  # perspective, not the finder


def test_recomputed_it_is_the_same_to_the_byte_without_an_image(refined, tmp_path):
    run = run_aerodft("recompute", refined[0], "-o", tmp_path / "again")
    assert run.code == 0, run.err
    comparison = compare_measurements(refined[0], tmp_path / "again")
    assert comparison.is_identical
    assert comparison.total.paired > 20
    assert seen_in(tmp_path / "again") == seen_in(refined[0])


def test_an_offset_of_others_observations_moves_none_of_its_own(flight, scenario, refined, tmp_path):
    late = {"time_offset_s": 0.25}
    markers = markers_of(scenario.world)
    config = write_station(flight / "late.toml", scenario.world, markers=markers, observations=late)
    run = run_aerodft("recompute", refined[0], "-c", config, "-o", tmp_path / "late")
    assert run.code == 0, run.err
    assert seen_in(tmp_path / "late") == seen_in(refined[0])


@pytest.mark.nightly
def test_looking_again_gives_the_same_bytes(flight, scenario, refined):
    imported(
        flight, scenario.world, "twice", "--observations", flight / "observations.jsonl",
        markers=markers_of(scenario.world),
    )  # fmt: skip
    assert compare_measurements(refined[0], flight / "twice").is_identical
    assert seen_in(flight / "twice") == seen_in(refined[0])


def test_toys_strangers_and_the_rate_are_counted(flight, scenario, refined, caplog):
    times = Counter(each.name.split("-")[1] for each in seen_in(refined[0]))
    (often, _), (next_often, _) = times.most_common(2)
    toys = markers_of(scenario.world, corners=False, scale=3.0)
    toys = {**toys, "marker": [each for each in toys["marker"] if each["id"] != int(often)], "every_s": 0.4}
    run = imported(flight, scenario.world, "toys", markers=toys)
    looks = run.json["markers"]
    assert looks["images"] == 13
    assert set(looks["not_surveyed"]) == {often}
    assert next_often in looks["wrong_size"]
    assert not seen_in(flight / "toys")
    assert caplog.text.count(f"shows marker-{often}, which is not surveyed") == 1


def test_without_images_there_is_nothing_to_look_at(flight, scenario):
    config = write_station(flight / "blind.toml", scenario.world, markers=markers_of(scenario.world))
    run = run_aerodft("import", flight / "flight.tlog", "--rate", 5, "-c", config, "-o", flight / "blind")
    assert run.code == 3
    assert "images" in run.last
    assert "[markers]" in run.last
    assert not (flight / "blind").exists()


@pytest.fixture(scope="module")
def served(scenario, tmp_path_factory):
    """The same flight through real sockets: the folder and the service's summary."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "camera.toml").write_text(tomli_w.dumps(camera_document(scenario.camera)))
    endpoint, mavlink, video = free_endpoint(), free_udp_port(), free_udp_port()
    config = write_station(
        folder / "station.toml",
        scenario.world,
        telemetry={"connection": f"udpin:127.0.0.1:{mavlink}"},
        images={"stream": f"udp://127.0.0.1:{video}"},
        zenoh={"listen": endpoint},
        markers=markers_of(scenario.world),
    )
    service = Service(config, "-o", folder / "recording")
    simulator = [
        *(sys.executable, "-m", "aerodft.sim", "--out", folder / "flight", "--live", "--duration", 5, "--fps", 5),
        *("--camera", folder / "camera.toml", "--mavlink", f"udpout:127.0.0.1:{mavlink}"),
        *("--video", f"udp://127.0.0.1:{video}", "--zenoh", endpoint, "--station", "live"),
        *("--bias", f"height={HEIGHT_BIAS_M},tilt={TILT_BIAS_DEG}"),
    ]
    try:
        service.wait_for("recording to")
        subprocess.run(list(map(str, simulator)), check=True, capture_output=True, timeout=PATIENCE_S)
        time.sleep(1.0)  # what is under way arrives; the tests tell if it did not
        assert service.end() == 0
    finally:
        service.end()
    return folder


@pytest.mark.nightly
def test_live_what_is_seen_is_recorded_with_its_image_and_refines(served):
    images = {each.index: each for each in map(decode_image, raw(served / "recording", IMAGE_SCHEMA))}
    seen = seen_in(served / "recording")
    assert seen
    for each in seen:
        assert each.clock is StampClock.HOST
        assert each.stamp_ns == images[each.image].stamp_ns
        assert each.arrival_ns > images[each.image].arrival_ns
    last = decoded(served / "recording", ESTIMATE)[-1]
    assert last["updates"] > 4
    for name, planted in (("height_m", -HEIGHT_BIAS_M), ("tilt_deg", -TILT_BIAS_DEG)):
        assert abs(last["bias"][name]["value"] - planted) < 4 * last["bias"][name]["std"]


@pytest.mark.nightly
def test_live_recomputed_is_the_same_to_the_byte(served):
    run = run_aerodft("recompute", served / "recording", "-o", served / "again")
    assert run.code == 0, run.err
    comparison = compare_measurements(served / "recording", served / "again")
    assert comparison.is_identical
    assert comparison.total.paired > 5
    assert decoded(served / "again", ESTIMATE) == decoded(served / "recording", ESTIMATE)


def test_markers_are_found_again_in_the_recorded_images(flight, scenario, tmp_path):
    markers, record = markers_of(scenario.world), {"image_hz": 1000.0, "jpeg_quality": 95}
    seen = ("--observations", flight / "observations.jsonl")
    imported(flight, scenario.world, "kept", *seen, markers=markers, record=record)
    count = len(seen_in(flight / "kept"))
    run = run_aerodft("recompute", flight / "kept", "--redetect", "-o", tmp_path / "again", "--json")
    assert run.code == 0, run.err
    vision = run.json["vision"]
    assert (vision["found"] + vision["lost"], vision["kept"]) == (count, 0)
    assert vision["lost"] + vision["new"] <= 0.05 * count
    assert vision["median_px"] < 0.1
    assert len(seen_in(tmp_path / "again")) == vision["found"] + vision["new"]
    errors, stds = width_errors(flight, tmp_path / "again", SETTLED_S)
    assert np.sqrt(np.mean(errors**2)) < 0.01
    assert np.all(np.abs(errors) < 4 * stds)


def test_what_cannot_be_looked_at_again_is_refused(flight, scenario, refined, tmp_path):
    bare = run_aerodft("recompute", refined[0], "--redetect", "-o", tmp_path / "again")
    assert (bare.code, "no images in the recording; record.image_hz" in bare.last) == (4, True)
    imported(flight, scenario.world, "blind", "--observations", flight / "observations.jsonl")
    blind = run_aerodft("recompute", flight / "blind", "--redetect", "-o", tmp_path / "again")
    nothing = (
        "--redetect: got a configuration without [markers], [camera_motion], [objects], [river] and tracked probes"
    )
    assert (blind.code, nothing in blind.last) == (2, True)
    assert not (tmp_path / "again").exists()
