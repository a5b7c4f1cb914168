"""A recorded flight through the pipeline, into a new recording."""

from pathlib import Path

from aerodft.adapters.config.station import StationConfig
from aerodft.cli.ending import Interruptible
from aerodft.cli.flight import open_flight
from aerodft.cli.looking import build_eyes
from aerodft.cli.output import progress_bar
from aerodft.cli.summary import report
from aerodft.cli.wiring import RECORDED_SPAN_NS, Tally, build_pipeline, build_recorder, closing_recorder, run
from aerodft.service.feed import MergedFeed
from replay.segments import is_mcap


def measure_flight(
    station: StationConfig,
    log: Path | None,
    observations: tuple[Path, ...],
    output: Path,
    *,
    where: Path,
    as_json: bool,
) -> None:
    """Measure a flight from its files, record it, and say what came of it.

    Args:
        station: The station, complete.
        log: As for :func:`aerodft.cli.flight.open_flight`.
        observations: Files of observed pixels, beside those of the station.
        output: A new folder.
        where: The configuration's name in messages.
        as_json: Print the summary as JSON.

    Raises:
        AerodftError: A file cannot be read, or nothing could be measured.
    """
    tally, pipeline = Tally(), build_pipeline(station)
    eyes = build_eyes(station, pipeline, where, may_record=log is not None and is_mcap(log))
    flight = open_flight(station, log, (*station.observations.files, *observations), eyes.lookouts)
    recorder = build_recorder(station, output, started_ns=flight.first_ns, lossless=True)
    with closing_recorder(recorder, output), progress_bar("importing", flight.first_ns, flight.last_ns) as progress:
        feed = Interruptible(MergedFeed(flight.sources, station.pipeline.tick_ns))
        run(feed, pipeline, (recorder, tally), progress, span_ns=0 if eyes.lookouts else RECORDED_SPAN_NS)
    seen = eyes.report(flight.looked.counts)
    report(recorder.totals, tally, pipeline.counts, as_json=as_json, warnings=flight.warnings(), seen=seen)
