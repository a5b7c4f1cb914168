"""A disk that fills up while something is recorded: what is lost is said, and the exit code says it too."""

from contextlib import ExitStack

from aerodft.adapters.recording.write import McapRecorder
from tests.full_disk import no_file_above


def test_a_recording_that_does_not_fit_is_a_loss(aerodft, desk, monkeypatch):
    out, log, begin = desk.folder / "rec", desk.tlog(seconds=30.0), McapRecorder.__init__
    with ExitStack() as limits:

        def begin_and_fill_up(*arguments, **options):
            begin(*arguments, **options)
            limits.enter_context(no_file_above(10_000))

        monkeypatch.setattr(McapRecorder, "__init__", begin_and_fill_up)
        done = aerodft("import", log, "-c", desk.config, "-o", out, "--json")
    assert done.code == 5, done.err
    lost = done.json["lost"]
    assert lost > 100
    assert f"aerodft: {out}: {lost} messages are not in the recording: they could not be written" in done.err
