"""The status that ``serve`` gives once a second says how the vehicle is."""

import json
from pathlib import Path

import jsonschema
from mcap.reader import make_reader

from .autopilot import StandIn, flying, free_port

SCHEMA = Path(__file__).parents[2] / "docs/schema/status-1.json"
STATION = """
[station]
name = "s"
[camera]
name = "c"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
[telemetry]
connection = "udpin:127.0.0.1:{port}"
[images]
rate_hz = 2
[zenoh]
enabled = false
[[probe]]
name = "p"
kind = "range"
pixels = [[960, 540]]
"""


def _statuses(recording: Path) -> list[dict]:
    found = []
    for segment in sorted(recording.glob("data_*.mcap")):
        with segment.open("rb") as file:
            messages = make_reader(file).iter_messages()
            found += [json.loads(message.data) for _, channel, message in messages if channel.topic.endswith("status")]
    return found


def test_the_status_says_how_the_vehicle_is(aerodft, tmp_path: Path) -> None:
    vehicle = StandIn(free_port())
    vehicle.intervals_s |= {"GPS_RAW_INT": 0.5, "EKF_STATUS_REPORT": 0.5, "RANGEFINDER": 0.2}
    config = tmp_path / "station.toml"
    config.write_text(STATION.format(port=vehicle.port))
    with flying(vehicle):
        done = aerodft("serve", config, "-o", tmp_path / "recording", "--seconds", 4)
    assert done.code == 4, done.err  # no camera attitude: no pose
    statuses = _statuses(tmp_path / "recording")
    for status in statuses:
        jsonschema.validate(status, json.loads(SCHEMA.read_text()))
    running = [each for each in statuses if each["state"] == "running"]
    assert len(running) >= 3
    (rejected,) = running[-1]["rejected"].items()
    assert rejected[0] == "RANGEFINDER: distance is no height"
    assert running[0]["rejected"].get(rejected[0], 0) < rejected[1] < 30
    health = running[-1]["health"]
    assert health["heartbeat_age_s"] < 1.5
    assert (health["gps"]["fix"], health["gps"]["satellites"], health["gps"]["horizontal_std_m"]) == (3, 14, 0.8)
    assert health["estimator"]["has_attitude"] is True
    assert set(health["estimator"]["test_ratios"].values()) == {0.10000000149011612}  # 0.1 in 32 bits
    assert health["link"]["lost"] == 0
    assert health["link"]["received"] > 20
    assert {"heartbeat", "gps", "estimator", "position", "vehicle attitude", "clock"} <= health["ages_s"].keys()
