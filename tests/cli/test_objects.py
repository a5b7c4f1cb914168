"""What moves before a fixed camera, and what a detector says does: from a video to tracks, and the same again."""

import csv
import json

import numpy as np
import pytest

from aerodft.sim.yard import write_yard


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    folder = tmp_path_factory.mktemp("yard")
    write_yard(folder, seconds=4.5, width_px=640)
    return folder


@pytest.fixture(scope="module")
def imported(yard, aerodft):
    done = aerodft("import", "--config", yard / "station.toml", "-o", yard / "rec", "--json")
    assert done.code == 0, done.err
    return done


def measurements(aerodft, recording, target):
    assert aerodft("export", recording, "--format", "jsonl", "-o", target).code == 0
    return [json.loads(line) for line in target.read_text().splitlines()]


def truth(yard):
    places = {}
    for row in csv.DictReader((yard / "truth.csv").read_text().splitlines()):
        places.setdefault(row["stamp_ns"], []).append([float(row["east_m"]), float(row["north_m"])])
    return {stamp: np.array(place) for stamp, place in places.items()}


def test_every_walker_has_one_track_within_its_ellipse(yard, imported, aerodft, tmp_path):
    assert imported.json["objects"]["images"] == 45
    where, owners, inside = truth(yard), {}, []
    for each in measurements(aerodft, yard / "rec", tmp_path / "all.jsonl"):
        if each["kind"] == "track":
            off = np.array(each["enu_m"][0][:2]) - where[each["stamp_ns"]]
            nearest = int(np.argmin(np.linalg.norm(off, axis=-1)))
            owners.setdefault(each["name"], set()).add(nearest)
            cov = np.array(each["cov_enu_m2"])[:2, :2]
            inside.append(off[nearest] @ np.linalg.solve(cov, off[nearest]) < 5.99)
            assert each["unit"] == "m/s"
    assert sorted(map(tuple, owners.values())) == [(0,), (1,), (2,)]
    assert np.mean(inside) > 0.9


def test_recomputed_tracks_are_the_same_to_the_byte(yard, imported, aerodft, tmp_path):
    assert imported.code == 0
    assert aerodft("recompute", yard / "rec", "-o", tmp_path / "again").code == 0
    same = aerodft("compare", yard / "rec", tmp_path / "again", "--tolerance", "0m")
    assert same.code == 0, same.err


def test_vision_says_where_it_is_shown_too_few_images(yard, imported, aerodft, tmp_path):
    assert imported.code == 0
    again = aerodft("recompute", yard / "rec", "--redetect", "-o", tmp_path / "seen", "--json")
    assert again.code == 0, again.err
    assert again.json["vision"]["kept"] > 20
    assert any("[objects]" in each and "not recorded" in each for each in again.json["warnings"])


@pytest.mark.nightly
def test_a_drone_s_walkers_are_tracked_from_the_video_on_and_the_same_again(aerodft, tmp_path):
    write_yard(tmp_path, is_flown=True, seconds=6.0, width_px=640)
    done = aerodft(
        "import", tmp_path / "flight.tlog", "--config", tmp_path / "station.toml", "-o", tmp_path / "rec", "--json"
    )
    assert done.code == 0, done.err
    assert done.json["objects"]["images"] == 60
    where, owners, inside = truth(tmp_path), {}, []
    for each in measurements(aerodft, tmp_path / "rec", tmp_path / "all.jsonl"):
        if each["kind"] == "track" and each["enu_m"]:
            off = np.array(each["enu_m"][0][:2]) - where[each["stamp_ns"]]
            nearest = int(np.argmin(np.linalg.norm(off, axis=-1)))
            owners.setdefault(each["name"], set()).add(nearest)
            cov = np.array(each["cov_enu_m2"])[:2, :2]
            inside.append(off[nearest] @ np.linalg.solve(cov, off[nearest]) < 5.99)
    assert len(owners) >= 2
    assert all(len(own) == 1 for own in owners.values())
    assert len(inside) >= 40
    assert np.mean(inside) > 0.9
    assert aerodft("recompute", tmp_path / "rec", "-o", tmp_path / "again").code == 0
    same = aerodft("compare", tmp_path / "rec", tmp_path / "again", "--tolerance", "0m")
    assert same.code == 0, same.err


def test_a_detector_s_boxes_are_tracked_and_measured_as_well(yard, aerodft, tmp_path):
    """Boxes of one who walks, as a detector would give them; aerodft itself looks for nothing."""
    text = (yard / "station.toml").read_text().replace("[objects]", "[objects]\ndetect = false")
    probe = '\n[[probe]]\nname = "walker"\nkind = "height"\nobserved = true\nstd_px = 2.0\n'
    (yard / "boxes.toml").write_text(text + probe)
    lines = []
    for image in range(20, 40):
        u = 300.0 + 3 * image
        box = [u, 200.0, u + 30, 310.0]
        lines += [{"image": image, "name": "objects", "box": box}, {"image": image, "name": "walker", "box": box}]
    lines.append({"image": 40, "name": "objects", "pixels": []})
    (yard / "boxes.jsonl").write_text("\n".join(map(json.dumps, lines)))
    done = aerodft(
        "import", "--config", yard / "boxes.toml", "--observations", yard / "boxes.jsonl", "-o", tmp_path / "rec"
    )
    assert done.code == 0, done.err
    found = measurements(aerodft, tmp_path / "rec", tmp_path / "boxes.jsonl")
    tracks = [each for each in found if each["kind"] == "track"]
    assert [each["status"] for each in tracks] == ["ok"] * 18 + ["OCCLUDED"]
    assert {each["name"] for each in tracks} == {"object-1"}
    assert tracks[-1]["value"] is None
    assert tracks[-1]["enu_m"] is not None
    heights = [each for each in found if each["name"] == "walker"]
    assert [each["status"] for each in heights] == ["ok"] * 20
    again = aerodft("recompute", tmp_path / "rec", "-o", tmp_path / "again")
    assert again.code == 0, again.err
    assert aerodft("compare", tmp_path / "rec", tmp_path / "again", "--tolerance", "0m").code == 0
