"""What a measurement says besides its numbers: its circumstances, and why there is no answer where there is none."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.points import ImagePoints
from aerodft.dft.projection import GroundPoints
from aerodft.dft.request import Request, Setup
from aerodft.dft.uncertainty import Z95, ellipse95
from aerodft.dft.values import Value
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import Measurement, Vector
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import ProbeKind
from aerodft.model.status import CODES, Status

UNITS = {ProbeKind.AREA: ("m2", 1.0), ProbeKind.BEARING: ("deg", math.degrees(1.0))}
"""Unit of a value, and what an SI value is multiplied with, where it is not in metres."""


@dataclass(frozen=True, slots=True)
class Record:
    """What a measurement says of its circumstances, whether it has an answer or not."""

    setup: Setup
    sample: PoseSample
    request: Request
    image: int | None

    def miss(self, status: Status, *reasons: str) -> Measurement:
        """A measurement without an answer."""
        return Measurement(
            name=self.request.probe.name,
            kind=self.request.probe.kind,
            status=status,
            reasons=reasons,
            stamp_ns=self.sample.stamp_ns,
            pixels=self.request.pixels,
            std_px=self.request.std_px,
            camera=self.setup.camera.name,
            model=self.setup.model,
            pose=self.sample,
            image=self.image,
            calibration=self.sample.calibration,
            config=self.setup.config_id,
        )

    def answer(self, pose: Pose, points: ImagePoints, value: Value | None, cov_enu_m2: FloatArray) -> Measurement:
        """A measurement with its value, if its kind has one, and its points, if all of them are on the ground."""
        kind = self.request.probe.kind
        unit, scale = UNITS.get(kind, ("m", 1.0))
        answer = replace(self.miss(Status.OK, *self.sample.reasons), unit=unit)
        if value is not None:
            low, high = value.ci95
            answer = replace(answer, value=scale * value.value, std=scale * value.std, ci95=(scale * low, scale * high))
        if kind is ProbeKind.HEIGHT and value is not None:
            points = points.upright(self.sample.origin, pose, value.value)
        elif points.ground.status.any() or (kind is ProbeKind.BEARING and len(points.range_m) == 1):
            return answer  # a ray has a bearing whether it meets the ground or not
        return replace(
            answer,
            ellipse95=ellipse95(cov_enu_m2) if kind is ProbeKind.POSITION else None,
            ground_m=_tuples(points.ground_m),
            enu_m=_tuples(points.ground.points_enu_m),
            cov_enu_m2=_tuples(cov_enu_m2),
            geo=points.geo,
            range_m=tuple(points.range_m.tolist()),
        )

    def no_ground(self, pose: Pose, ground: GroundPoints, index: int) -> Measurement:
        """Why the point ``index`` is nowhere on the ground."""
        status = CODES[ground.status[index]]
        u, v = self.request.pixels[index]
        return self.miss(status, f"pixel {index} ({u:g}, {v:g}) {self._why(pose, status, ground, index)}")

    def _why(self, pose: Pose, status: Status, ground: GroundPoints, index: int) -> str:
        camera, up_m = self.setup.camera, float(pose.position_enu_m[2])
        if status is Status.ABOVE_HORIZON:
            below = math.degrees(float(ground.depression_rad[index]))
            if below > 0 and self.setup.ground is not None:
                return f"looks {below:.1f} deg below the horizon, along ground that falls away as steeply"
            return f"looks {abs(below):.1f} deg above the horizon"
        if status is Status.BELOW_SURFACE:
            elevation_m = self.request.probe.elevation_m
            if self.setup.ground is not None:
                foot_m = float(self.setup.ground.height_at(pose.position_enu_m[:2]))
                return f"is seen from {up_m - foot_m:.2f} m above the ground, measured is {elevation_m:.2f} m above it"
            return f"is seen from {up_m:.2f} m, measured is the plane at {elevation_m:.2f} m"
        return {
            Status.OUT_OF_IMAGE: f"is outside the image of {camera.width_px} x {camera.height_px} px",
            Status.BEYOND_TERRAIN: "looks past the border of the elevation model",
            Status.NO_ELEVATION: "looks over a hole in the elevation model",
        }.get(status, "is outside the valid radius of the lens model")

    def refuse(self, on_ground: ImagePoints, half_m: FloatArray) -> Measurement:
        """Say how badly the worst point is known; ``half_m (k,)`` is half of its range's 95 % interval."""
        index = int(np.argmax(half_m / on_ground.range_m))
        below, range_m = math.degrees(float(on_ground.ground.depression_rad[index])), float(on_ground.range_m[index])
        spread = f"+- {half_m[index]:.0f} m (95 %)" if math.isfinite(half_m[index]) else "and may be anything"
        sentence = f"point {index} is {below:.1f} deg below the horizon, range {range_m:.0f} m {spread}"
        return self.miss(Status.ILL_CONDITIONED, sentence)

    def refuse_bearing(self, value: Value) -> Measurement:
        """Say how badly a direction is known."""
        half = min(math.degrees(Z95 * value.std), 180.0) if math.isfinite(value.std) else 180.0
        return self.miss(Status.ILL_CONDITIONED, f"the direction is known to +- {half:.0f} deg (95 %)")


def _tuples(rows: FloatArray) -> tuple[Vector, ...]:
    return tuple(tuple(row) for row in rows.tolist())
