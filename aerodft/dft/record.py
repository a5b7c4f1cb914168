"""What an answer says besides its numbers: why there is none where there is none, and its points where there is one."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.dft.answers import Answer
from aerodft.dft.points import ProbePoints, lat_lon_alt, to_ground_frame
from aerodft.dft.projection import GroundPoints
from aerodft.dft.request import Request, Setup
from aerodft.dft.uncertainty import Z95, ellipses95
from aerodft.dft.values import Value
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import Probe, ProbeKind
from aerodft.model.status import CODES, Status

UNITS = {ProbeKind.AREA: ("m2", 1.0), ProbeKind.BEARING: ("deg", math.degrees(1.0))}
"""Unit of a value, and what an SI value is multiplied with, where it is not in metres."""


def no_answer(probe: Probe, status: Status, reasons: tuple[str, ...]) -> Answer:
    """There is no number, in the unit that it would have."""
    unit, _ = UNITS.get(probe.kind, ("m", 1.0))
    return Answer(status, reasons, unit)


@dataclass(frozen=True, slots=True)
class Record:
    """One request at one pose, and what can be said of it."""

    setup: Setup
    sample: PoseSample
    request: Request

    def miss(self, status: Status, *reasons: str) -> Answer:
        """There is no answer."""
        return no_answer(self.request.probe, status, reasons)

    def answer(self, pose: Pose, points: ProbePoints, value: Value | None, cov_enu_m2: FloatArray) -> Answer:
        """The value, if its kind has one, and the points, if all of them are on the ground."""
        kind, origin = self.request.probe.kind, self.sample.origin
        unit, scale = UNITS.get(kind, ("m", 1.0))
        answer = Answer(Status.OK, self.sample.reasons, unit)
        if value is not None:
            low, high = value.ci95
            answer = answer._replace(value=scale * value.value, std=scale * value.std, ci95=(scale * low, scale * high))
        enu_m = points.ground.points_enu_m
        if kind is ProbeKind.HEIGHT and value is not None:
            enu_m = np.stack([enu_m[0], enu_m[0] + [0.0, 0.0, value.value]])  # the top above the base
        elif points.ground.status.any() or (kind is ProbeKind.BEARING and len(enu_m) == 1):
            return answer  # a ray has a bearing whether it meets the ground or not
        return answer._replace(
            ellipse95=ellipses95(cov_enu_m2).tolist() if kind is ProbeKind.POSITION else None,
            ground_m=to_ground_frame(pose, enu_m).tolist(),
            enu_m=enu_m.tolist(),
            cov_enu_m2=cov_enu_m2.tolist(),
            geo=None if origin is None else lat_lon_alt(origin, enu_m).tolist(),
            range_m=np.linalg.norm(enu_m - pose.position_enu_m, axis=-1).tolist(),
        )

    def no_ground(self, pose: Pose, ground: GroundPoints, index: int) -> Answer:
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

    def refuse_bearing(self, value: Value) -> Answer:
        """Say how badly a direction is known."""
        half = min(math.degrees(Z95 * value.std), 180.0) if math.isfinite(value.std) else 180.0
        return self.miss(Status.ILL_CONDITIONED, f"the direction is known to +- {half:.0f} deg (95 %)")
