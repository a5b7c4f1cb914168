"""What takes longest comes first: the last file that a worker gets is then a short one."""

from pathlib import Path

LONG = {"test_coverage_coarse.py": 0, "test_coverage.py": 1, "test_calibration_simulated.py": 2}
TRUTH = Path(__file__).parent / "truth"


def pytest_collection_modifyitems(items):
    """Files stay together, in their order, but for the long ones."""
    items.sort(key=lambda item: (LONG.get(item.path.name, len(LONG)), item.path.parent != TRUTH))
