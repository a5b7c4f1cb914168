"""Height and angle from half of the paper's Table 2 measure the other half better than the paper's own.

Pixel rows are those at which the paper's printed estimates lie (they are not printed themselves); ranges are its ground
truth. Everything goes through the command line: ``calibrate`` writes a file with which ``measure`` measures.
"""

import math
from pathlib import Path

import pytest

from aerodft.dft.paper import CANON, table_2

from .calibration_files import aerodft, write_evidence

CAMERA = Path(__file__).parents[2] / "configs/cameras/canon-1000d.toml"
ODD, EVEN = slice(0, None, 2), slice(1, None, 2)


def calibrated(folder, rows):
    """What ``calibrate`` says of these rows of the table, and the file that it writes."""
    ranges = [
        {"name": f"case-{row.printed.case}", "pixel": [CANON.width_px / 2, row.row_px], "range_m": row.printed.truth_m}
        for row in rows
    ]
    observations, output = write_evidence(folder / "ranges.toml", range=ranges), folder / "calibration.toml"
    answer = aerodft(
        "calibrate", observations, "--camera", CAMERA, "--unknowns", "height,tilt", "--model", "dft", "-o", output
    )
    assert answer.code == 0, answer.words
    return answer, output


def measured_m(calibration, rows):
    """Slant ranges of these rows with that calibration."""
    probes = [f"--probe=range {CANON.width_px / 2},{row.row_px} name=case-{row.printed.case}" for row in rows]
    answer = aerodft("measure", "--camera", CAMERA, "--calibration", calibration, *probes)
    assert answer.code == 0, answer.words
    return [each["value"] for each in answer.document]


@pytest.mark.parametrize(
    ("used", "held_out", "most_percent", "most_m"),
    [(ODD, EVEN, 1.15, 1.6), (EVEN, ODD, 0.75, 0.95)],
    ids=["odd rows measure the even ones", "even rows measure the odd ones"],
)
def test_half_of_table_2_measures_the_other_half(used, held_out, most_percent, most_m, tmp_path):
    rows = table_2()
    answer, calibration = calibrated(tmp_path, rows[used])
    found_m = measured_m(calibration, rows[held_out])
    height, tilt = (answer.document["parameters"][name] for name in ("height_agl_m", "tilt_deg"))
    print(
        f"\nheight {height['value']:.3f} +- {height['std']:.3f} m (paper 10.48), tilt {tilt['value']:.3f} +-"
        f" {tilt['std']:.3f} deg (paper 67.0)\ncase   truth  measured  off (m)  off (%)   paper (m)  paper (%)"
    )
    off_m, off_percent = [], []
    for row, found in zip(rows[held_out], found_m, strict=True):
        printed = row.printed
        off_m.append(abs(found - printed.truth_m))
        off_percent.append(100 * off_m[-1] / printed.truth_m)
        print(
            f"{printed.case:4d} {printed.truth_m:7.2f} {found:9.2f} {found - printed.truth_m:8.2f}"
            f" {off_percent[-1]:8.2f} {printed.error_m:11.2f} {printed.error_percent:10.2f}"
        )
        psi = math.radians(tilt["value"]) + (CANON.height_px / 2 - row.row_px) * CANON.vfov_rad / CANON.height_px
        assert found == pytest.approx(height["value"] / math.cos(psi), rel=1e-9), "Eq. 3, 4 and 6 with X = 0"
    assert max(off_percent) <= most_percent
    assert max(off_m) <= most_m
