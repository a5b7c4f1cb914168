"""``aerodft recover``: a recording whose recorder was killed, or whose files were damaged, made whole in place."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.options import JsonOption
from aerodft.cli.output import LOSS, print_json, say
from aerodft.errors import NoAnswerError, Reason

if TYPE_CHECKING:
    from aerodft.adapters.recording.recover import DataLoss, Recovery, SegmentRecovery


def recover(
    folder: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    json: JsonOption = False,
) -> None:
    r"""Complete unfinished segments of a recording in place, leave out what is damaged, and say what is lost.

    Sound segments are not touched. In a folder of recordings, those are recovered that were not finished and that
    nobody is writing. Exit code 0: nothing is lost; 5: something is, and is named; 4: there is nothing to recover.

    \b
    Example:
      aerodft recover recordings/river-20261121-101500
    """
    from aerodft.adapters.recording.recover import is_recording
    from aerodft.app.recordings import recover as recover_recordings

    recoveries = recover_recordings(folder)
    if json:
        documents = [_document(recovery) for recovery in recoveries]
        print_json(documents[0] if is_recording(folder) else {"recordings": documents})
    for recovery in recoveries:
        _say(recovery)
    if recoveries and not any(recovery.messages for recovery in recoveries):
        raise NoAnswerError("nothing can be recovered", where=folder, got=Reason("no segment holds a whole message"))
    if any(recovery.is_lossy for recovery in recoveries):
        raise typer.Exit(LOSS)


def _say(recovery: "Recovery") -> None:
    for segment in recovery.segments:
        path = recovery.folder / segment.name
        say(f"{path}: {segment.state}, {segment.messages} messages")
        for loss in segment.losses:
            say(f"aerodft: {path}: {_sentence(loss)}")


def _document(recovery: "Recovery") -> dict[str, object]:
    return {
        "recording": str(recovery.folder),
        "messages": recovery.messages,
        "is_lossy": recovery.is_lossy,
        "segments": [
            _stamps_as_text(segment) | {"losses": [_stamps_as_text(loss) for loss in segment.losses]}
            for segment in recovery.segments
        ],
    }


def _stamps_as_text(value: "SegmentRecovery | DataLoss") -> dict[str, object]:
    return {
        name: str(each) if name.endswith("_ns") and each is not None else each for name, each in asdict(value).items()
    }


def _sentence(loss: "DataLoss") -> str:
    begin = "the beginning" if loss.from_ns is None else unix_ns_to_iso(loss.from_ns)
    end = "the end" if loss.to_ns is None else unix_ns_to_iso(loss.to_ns)
    where = "" if loss.offset is None else f", {loss.length} bytes at byte {loss.offset}"
    many = "" if loss.messages is None else f", {loss.messages} messages"
    return f"lost between {begin} and {end}{many}{where}: {loss.what}"
