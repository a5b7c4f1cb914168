"""What is recorded as a measurement or an observation, and is none, is refused before anything is made of it."""

import shutil
from pathlib import Path

import orjson
import pytest

from aerodft.adapters.wire.events import OBSERVATION_SCHEMA
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA
from aerodft.errors import InputError
from replay.compare.probe_series import _row_of_payload
from replay.export import parse_measurement, row_of
from replay.recordings import Recording
from tests.payloads import decode_observation

FROZEN = Path(__file__).parents[1] / "cli/frozen-0.1"


def one(schema: str) -> bytes:
    payloads = [each.data for each in Recording(FROZEN).messages(wanted=lambda channel: channel.schema == schema)]
    return next((each for each in payloads if b'"status":"ok"' in each and b'"unit":"m"' in each), payloads[0])


def changed(payload: bytes, way: str, value: object) -> bytes:
    """A payload with another value at ``pose.std`` or the like."""
    whole = orjson.loads(payload)
    item = whole
    *outer, last = way.split(".")
    for key in outer:
        item = item[int(key)] if isinstance(item, list) else item[key]
    item[int(last) if isinstance(item, list) else last] = value
    return orjson.dumps(whole)


def test_all_that_was_recorded_is_taken() -> None:
    for payload in Recording(FROZEN).measurements():
        row_of(parse_measurement(payload))


@pytest.mark.parametrize(
    ("way", "value"),
    [
        ("pose.std", None),
        ("pose.std", []),
        ("pose", "x"),
        ("pose.height_agl_m", {}),
        ("pose.heading_deg", [[1.0, 2.0]]),
        ("name", 7),
        ("name", None),
        ("kind", None),
        ("stamp_ns", None),
        ("stamp_ns", "1795221278868833000000000000"),
        ("stamp_ns", 2**63),
        ("pixels", "text"),
        ("pixels", [1e308]),
        ("pixels", [[1.0, 2.0, 3.0]]),
        ("geo.0.lon_deg", 1e308),
        ("geo.0.lat_deg", 91.0),
        ("std", 1e308),
        ("image", 1.5),
    ],
)
def test_no_measurement(way: str, value: object) -> None:
    payload = changed(one(MEASUREMENT_SCHEMA), way, value)
    with pytest.raises(InputError, match="a recorded measurement is none"):
        row_of(parse_measurement(payload))


@pytest.mark.parametrize(("way", "value"), [("name", 7), ("name", None), ("value", 1e308), ("unit", {})])
def test_no_measurement_to_compare(way: str, value: object) -> None:
    payload = changed(one(MEASUREMENT_SCHEMA), way, value)
    with pytest.raises(InputError, match="none"):
        _row_of_payload(payload, FROZEN)


@pytest.mark.parametrize(
    ("way", "value"),
    [
        ("name", {}),
        ("name", None),
        ("std_px", ""),
        ("std_px", 1e308),
        ("std_px", -1.0),
        ("std_px", [[1.0]]),
        ("pixels", [[1e308, 1.0]]),
        ("box", [0.0, 0.0, 1e308, 1.0]),
        ("contour", [[1e308, 1.0]] * 3),
        ("source", 5),
        ("unseen", ["x"]),
    ],
)
def test_no_observation(way: str, value: object) -> None:
    payload = one(OBSERVATION_SCHEMA)
    assert decode_observation(payload).name
    with pytest.raises(InputError, match="incomplete or wrong"):
        decode_observation(changed(payload, way, value))


def test_a_configuration_of_many_megabytes_is_none(tmp_path: Path) -> None:
    folder = tmp_path / "large"
    shutil.copytree(FROZEN, folder)
    assert "[station]" in (Recording(folder).text("config.toml") or "")
    with (folder / "config.toml").open("ab") as file:
        file.write(b"# as much as nobody writes\n" * (1 << 18))
    with pytest.raises(InputError, match="a configuration of more than 4 MB"):
        Recording(folder).text("config.toml")
