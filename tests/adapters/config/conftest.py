"""Elevation models on disk, from a function of metres to the east and north of a place."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

PIXEL_M = 5.0
COUNT = 201


@pytest.fixture
def write_dem() -> Callable[..., Path]:
    """``write_dem(path, height_of, lat_deg, lon_deg)``: 1 km by 1 km in an azimuthal map around the place."""
    rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
    affine = pytest.importorskip("affine", reason="the extra terrain is not installed")

    def write_dem(path: Path, height_of: Callable[..., np.ndarray], lat_deg: float, lon_deg: float) -> Path:
        along = (np.arange(COUNT) - (COUNT - 1) / 2) * PIXEL_M
        heights = np.broadcast_to(height_of(along[None, :], -along[:, None]), (COUNT, COUNT))
        corner = -COUNT / 2 * PIXEL_M
        profile = {
            "driver": "GTiff", "width": COUNT, "height": COUNT, "count": 1, "dtype": "float32", "nodata": -9999.0,
            "crs": f"+proj=aeqd +lat_0={lat_deg} +lon_0={lon_deg} +ellps=WGS84",
            "transform": affine.Affine(PIXEL_M, 0.0, corner, 0.0, -PIXEL_M, -corner),
        }  # fmt: skip
        with rasterio.open(path, "w", **profile) as file:
            file.write(np.where(np.isnan(heights), -9999.0, heights).astype("float32"), 1)
        return path

    return write_dem
