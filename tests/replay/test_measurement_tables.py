"""A recording's measurements as rows, as a data frame and as an Arrow table: the columns of an export, typed."""

import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import aerodft as ad
from replay.export.table import COLUMNS

FROZEN = Path(__file__).parents[1] / "cli" / "frozen-0.1"


@pytest.fixture(scope="module")
def measurements() -> ad.Measurements:
    return ad.open_recording(FROZEN).measurements()


def test_rows_frame_and_table_are_those_of_the_export(measurements: ad.Measurements, tmp_path: Path) -> None:
    assert ad.export(FROZEN, tmp_path / "x.parquet").counts == {"measurements": 118}
    table, frame, rows = measurements.to_arrow(), measurements.to_pandas(), list(measurements)
    assert table.equals(pq.read_table(tmp_path / "x.parquet"))
    assert list(frame.columns) == list(rows[0]) == table.column_names == list(COLUMNS)
    assert frame["stamp_ns"].tolist() == [row["stamp_ns"] for row in rows]
    assert frame["value"].dropna().tolist() == [row["value"] for row in rows if row["value"] is not None]
    assert frame["time_utc"].astype("int64").tolist() == frame["stamp_ns"].tolist()
    assert str(frame["image"].dtype) == "Int64"


def test_without_pandas_the_extra_is_named(measurements: ad.Measurements, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ad.InputError, match=r"install aerodft\[pandas\]"):
        measurements.to_pandas()


def test_a_recording_says_what_and_when() -> None:
    recording = ad.open_recording(str(FROZEN))
    assert (recording.path, recording.station, recording.is_whole) == (FROZEN, "frozen", True)
    assert recording.config is not None
    assert recording.config.startswith("[")
    assert recording.start_ns < recording.end_ns


def test_another_format_than_the_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ad.AerodftError, match="a name that ends with"):
        ad.export(FROZEN, tmp_path / "x.parquet", form="csv")
