"""[telemetry.signing]: read, written out again, and no part of what numbers depend on."""

import tomllib

import pytest

from aerodft.adapters.config.station import load_station, parse_station, resolved_toml
from aerodft.errors import ConfigError

STATION = """
[station]
name = "s"
[camera]
name = "c"
width_px = 640
height_px = 480
hfov_deg = 60.0
[telemetry]
connection = "udpin:14550"
"""


def write(folder, table=""):
    path = folder / "station.toml"
    path.write_text(STATION + table)
    return path


def test_files_are_relative_to_the_configuration(tmp_path):
    path = write(tmp_path, '[telemetry.signing]\nkey_file = "vehicle.key"\nstate_file = "stamps.json"\nlink_id = 3\n')
    signing = load_station(path).link.signing
    assert signing.key_file == tmp_path / "vehicle.key"
    assert signing.state_file == tmp_path / "stamps.json"
    assert (signing.link_id, signing.accept_unsigned) == (3, ("RADIO_STATUS",))


def test_it_survives_a_recording_and_changes_no_number(tmp_path):
    plain = load_station(write(tmp_path))
    signed = load_station(write(tmp_path, '[telemetry.signing]\nkey_file = "vehicle.key"\naccept_unsigned = []\n'))
    assert plain.link.signing is None
    again = parse_station(resolved_toml(signed).encode(), where="config.toml", folder=tmp_path / "elsewhere")
    assert again.link == signed.link
    assert again.pipeline.config_id == signed.pipeline.config_id == plain.pipeline.config_id


def test_a_recording_holds_no_key(tmp_path):
    (tmp_path / "vehicle.key").write_text("correct horse")
    text = resolved_toml(load_station(write(tmp_path, '[telemetry.signing]\nkey_file = "vehicle.key"\n')))
    assert "correct horse" not in text
    assert tomllib.loads(text)["telemetry"]["signing"]["key_file"] == str(tmp_path / "vehicle.key")


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("[telemetry.signing]\n", "telemetry.signing.key_file"),
        ('[telemetry.signing]\nkey = "x"\n', "telemetry.signing.key"),
        ('[telemetry.signing]\nkey_file = "k"\nlink_id = 256\n', "at most 255"),
        ('[telemetry.signing]\nkey_file = "k"\naccept_unsigned = ["radio"]\n', 'a message like "RADIO_STATUS"'),
    ],
)
def test_refusals(tmp_path, table, says):
    with pytest.raises(ConfigError) as refusal:
        load_station(write(tmp_path, table))
    assert says in str(refusal.value)


def test_signing_needs_a_link(tmp_path):
    path = write(tmp_path, '[telemetry.signing]\nkey_file = "k"\n')
    path.write_text(path.read_text().replace('connection = "udpin:14550"', ""))
    with pytest.raises(ConfigError, match="connection beside it"):
        load_station(path)
