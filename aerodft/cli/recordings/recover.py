"""``aerodft recover``: a recording whose recorder was killed, or whose files were damaged, made whole in place."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.recording.recover import (
    Loss,
    Recovery,
    SegmentRecovery,
    is_recording,
    recordings_in,
    recover_folder,
)
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.output import LOSS, print_json, say
from aerodft.errors import InputError, NoAnswerError


def recover(
    folder: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    r"""Complete unfinished segments of a recording in place, leave out what is damaged, and say what is lost.

    Sound segments are not touched. In a folder of recordings, those are recovered that were not finished and that
    nobody is writing. Exit code 0: nothing is lost; 5: something is, and is named; 4: there is nothing to recover.

    \b
    Example:
      aerodft recover recordings/river-20261121-101500
    """
    below = {} if is_recording(folder) else recordings_in(folder)
    recoveries = _all_of(below) if below else [recover_folder(folder)]
    if json:
        documents = [_document(recovery) for recovery in recoveries]
        print_json({"recordings": documents} if below else documents[0])
    for recovery in recoveries:
        _say(recovery)
    if recoveries and not any(recovery.messages for recovery in recoveries):
        raise NoAnswerError("nothing can be recovered", where=folder, got="no whole message in any segment")
    if any(recovery.is_lossy for recovery in recoveries):
        raise typer.Exit(LOSS)


def _all_of(below: Mapping[Path, bool]) -> list[Recovery]:
    recoveries = []
    for folder, is_finished in below.items():
        if is_finished:
            continue
        try:
            recoveries.append(recover_folder(folder))
        except InputError as error:  # being written, of another tool: the others are recovered all the same
            say(f"aerodft: {error}")
    return recoveries


def _say(recovery: Recovery) -> None:
    for segment in recovery.segments:
        path = recovery.folder / segment.name
        say(f"{path}: {segment.state}, {segment.messages} messages")
        for loss in segment.losses:
            say(f"aerodft: {path}: {_sentence(loss)}")


def _document(recovery: Recovery) -> dict[str, object]:
    return {
        "recording": str(recovery.folder),
        "messages": recovery.messages,
        "is_lossy": recovery.is_lossy,
        "segments": [_segment(segment) for segment in recovery.segments],
    }


def _segment(segment: SegmentRecovery) -> dict[str, object]:
    return {
        "name": segment.name,
        "state": segment.state,
        "messages": segment.messages,
        "start_ns": _text(segment.start_ns),
        "end_ns": _text(segment.end_ns),
        "losses": [
            asdict(loss) | {"from_ns": _text(loss.from_ns), "to_ns": _text(loss.to_ns)} for loss in segment.losses
        ],
    }


def _text(stamp_ns: int | None) -> str | None:
    return None if stamp_ns is None else str(stamp_ns)


def _sentence(loss: Loss) -> str:
    begin = "the beginning" if loss.from_ns is None else unix_ns_to_iso(loss.from_ns)
    end = "the end" if loss.to_ns is None else unix_ns_to_iso(loss.to_ns)
    where = "" if loss.offset is None else f", {loss.length} bytes at byte {loss.offset}"
    many = "" if loss.messages is None else f", {loss.messages} messages"
    return f"lost between {begin} and {end}{many}{where}: {loss.what}"
