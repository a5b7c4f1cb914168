"""How telemetry becomes a pose: from a station's tables to the pipeline's settings."""

import math

from aerodft.adapters.config.attitude import attitude_from
from aerodft.adapters.config.health_tables import health_from, zoom_from
from aerodft.adapters.config.pose_tables import HeightTable, TelemetryTable
from aerodft.adapters.config.units import to_ns
from aerodft.model.pose import HeightSource
from aerodft.service.settings import HeightSettings, TelemetrySettings


def telemetry_from(table: TelemetryTable) -> TelemetrySettings:
    """How telemetry becomes a pose."""
    return TelemetrySettings(
        system=table.system,
        component=table.component,
        gimbal=table.gimbal,
        height=_height(table.height),
        attitude=attitude_from(table.attitude, table.horizontal_std_m),
        health=health_from(table.health),
        zoom=zoom_from(table.zoom),
        wait_ns=to_ns(table.wait_s),
    )


def _height(table: HeightTable) -> HeightSettings:
    measured = HeightSettings().order
    by_default = measured if table.manual_m is None else (*measured, HeightSource.MANUAL)
    return HeightSettings(
        order=by_default if table.order is None else tuple(map(HeightSource, table.order)),
        std_m={HeightSource(name): std_m for name, std_m in table.std_m.model_dump().items()},
        home_above_plane_m=table.home_above_plane_m,
        manual_m=table.manual_m,
        min_m=table.min_m,
        max_gap_ns=to_ns(table.max_gap_s),
        rangefinder_gap_ns=to_ns(table.rangefinder_gap_s),
        terrain_gap_ns=to_ns(table.terrain_gap_s),
        terrain_max_distance_m=table.terrain_max_distance_m,
        lean_std_rad=math.radians(table.lean_std_deg),
    )
