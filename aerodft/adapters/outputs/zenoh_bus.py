"""``[zenoh]``: measurements on the bus while a station measures live."""

from typing import Annotated, Final

from aerodft.adapters.config import Many, Table, matching
from aerodft.adapters.outputs.output import Output, Run

Endpoint = Annotated[str, matching(r"(tcp|udp|tls|quic|ws)/\S+:\d+", 'like "tcp/127.0.0.1:7447"')]


class ZenohTable(Table):
    """The bus: loopback only and no multicast, unless somebody writes otherwise."""

    enabled: bool = True
    listen: Endpoint = "tcp/127.0.0.1:7447"
    connect: Many[Endpoint] = ()


TABLE: Final = "zenoh"
MODEL: Final = ZenohTable
DEFAULT: Final = ZenohTable()


def open_output(settings: ZenohTable, run: Run) -> Output | None:
    """The station on the bus; None of a run that is not live, or without it."""
    if not (settings.enabled and run.is_live):
        return None
    from aerodft.adapters.bus import ZenohBus  # noqa: PLC0415 - configurations are read without zenoh
    from aerodft.adapters.wire.requests import parse_measure_request  # noqa: PLC0415 - likewise

    return ZenohBus(
        run.station,
        settings.listen,
        settings.connect,
        probes=run.probes,
        on_measure=lambda question: run.measure(parse_measure_request(question, run.points)),
        on_observation=run.put_observation,
        in_utc=run.in_utc,
    )
