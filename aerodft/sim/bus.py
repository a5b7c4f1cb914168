"""Observations on zenoh, for a service that listens to ``aerodft/{station}/observation/{probe}``."""

from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from aerodft.adapters.zenoh.session import session_on
from aerodft.sim.live import Observe
from aerodft.sim.observations import Sighting


@contextmanager
def observation_publisher(endpoint: str, station: str) -> Iterator[Observe]:
    """Publishes sightings; connects only, listens nowhere, scouts nobody, and waits for a service that is not up yet.

    Args:
        endpoint: Where the service listens, for example ``tcp/127.0.0.1:7447``.
        station: The station's name in key expressions.

    Raises:
        LinkError: The endpoint makes no sense.
    """
    with session_on(None, [endpoint]) as session:

        def publish(seen: Sighting) -> None:
            key = f"aerodft/{station}/observation/{seen.name}"
            session.put(key, seen.observation_line(), encoding=zenoh.Encoding.APPLICATION_JSON)

        yield publish
