"""Observations on zenoh, for a service that listens to ``aerodft/{station}/observation/{probe}``."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from aerodft.errors import LinkError
from aerodft.sim.live import Observe
from aerodft.sim.observations import Sighting


@contextmanager
def observation_publisher(endpoint: str, station: str) -> Iterator[Observe]:
    """Publishes sightings; connects only, listens nowhere, scouts nobody, and waits for a service that is not up yet.

    Args:
        endpoint: Where the service listens, for example ``tcp/127.0.0.1:7447``.
        station: The station's name in key expressions.

    Raises:
        LinkError: The endpoint makes no sense to zenoh.
    """
    with _session(endpoint) as session:

        def publish(seen: Sighting) -> None:
            key = f"aerodft/{station}/observation/{seen.name}"
            session.put(key, seen.observation_line(), encoding=zenoh.Encoding.APPLICATION_JSON)

        yield publish


def _session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    try:
        for key, value in (
            ("mode", "peer"),
            ("connect/endpoints", [endpoint]),
            ("connect/exit_on_failure", False),
            ("listen/endpoints", []),
            ("scouting/multicast/enabled", False),
            ("scouting/gossip/enabled", False),
        ):
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError:
        raise LinkError(
            "zenoh cannot be opened", got=endpoint, expected="an endpoint like tcp/127.0.0.1:7447"
        ) from None
