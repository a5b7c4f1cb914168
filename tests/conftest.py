"""What takes longest comes first: the last file that a worker gets is then a short one, and no other waits for it."""

import gc
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.model import RawBlock, WireProtocol
from aerodft.service import block_of

settings.register_profile("untimed", deadline=None)  # the first example loads compiled functions
settings.load_profile("untimed")
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it in what it starts in the background

TESTS = Path(__file__).parent
DATA = TESTS.parents[1] / "shared" / "data"
LONGEST = (
    "web/test_live_page.py",
    "web/test_page.py",
    "test_documentation.py",
    "cli/test_demo.py",
    "faults/test_kills.py",
    "truth/test_calibration_simulated.py",
    "faults/test_memory.py",
    "truth/test_coverage_coarse.py",
    "cli/test_river_flight.py",
    "truth/test_in_flight_calibration.py",
    "truth/test_coverage.py",
    "faults/test_mutated_files.py",
    "truth/test_clocks_in_flight.py",
    "bench/test_bench_smoke.py",
    "truth/test_flight_coverage.py",
    "truth/test_river_stills.py",
    "truth/test_river_painted.py",
    "truth/test_walkers_from_above.py",
    "service/test_pipeline_determinism.py",
    "cli/test_serve.py",
    "cli/test_calibrate_refusals.py",
    "cli/test_calibrate_report.py",
    "truth/test_recorded_attitudes.py",
    "app/test_calibrate_markers.py",
    "cli/test_sync.py",
    "calibration/test_sync.py",
    "faults/test_every_write.py",
    "truth/test_recorded_flights.py",
    "cli/test_recompute_many.py",
    "truth/test_log_river_widths.py",
    "truth/test_tracked_probes.py",
    "calibration/test_markers.py",
    "truth/test_gimbal_frames.py",
    "truth/test_object_height.py",
    "truth/test_walkers.py",
    "cli/test_live_markers.py",
    "cli/test_replay.py",
    "cli/test_doctor_health.py",
    "calibration/test_conditions.py",
    "truth/test_river_real.py",
    "vision/test_steady_points.py",
    "vision/test_water_motion.py",
)
"""Eight seconds of a processor and more each, by day or at night, about the longest first."""
RANK = {TESTS / name: rank for rank, name in enumerate(LONGEST)}


def pytest_collection_modifyitems(items):
    """Files stay together, in their order, but for the long ones."""
    items.sort(key=lambda item: (RANK.get(item.path, len(RANK)), item.path.parent != TESTS / "truth"))


def pytest_collection_finish():
    """What is there before the first test is there to the end: it is not looked through again for what may go."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of recorded flights."""
    if not DATA.is_dir():
        pytest.skip(f"no recorded flights: {DATA} is absent")
    return DATA


@pytest.fixture(scope="session")
def pack() -> Callable[..., bytes]:
    """Packs a message as pymavlink does: ``pack(message, system=1, component=1, v1=False)``."""

    def packed(message: dialect.MAVLink_message, *, system: int = 1, component: int = 1, v1: bool = False) -> bytes:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        return bytes(message.pack(mav, force_mavlink1=v1))

    return packed


@pytest.fixture(scope="session")
def block() -> Callable[[list[bytes]], RawBlock]:
    """A block of frames that arrive a millisecond apart."""

    def made(frames: list[bytes]) -> RawBlock:
        return block_of(WireProtocol.MAVLINK, "test", [10**18 + k * 10**6 for k in range(len(frames))], frames)

    return made
