"""What makes banks hard to find: waves, foam, mirrored sky, glare, shade, mud and rank growth.

The water's edge stays where the river says; nothing here stands above the plane.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.jit import njit, njit_inline
from aerodft.model import FloatArray, ImageArray
from aerodft.sim.render import Renderer
from aerodft.sim.shading import (
    HAZE_PER_M2,
    SKY,
    Appearance,
    CameraState,
    Rays,
    RiverFrame,
    Tiles,
    gap_to_bank,
    paint_sky,
    sample,
    trace_ground,
    water_fraction,
)

_STRETCH = 5.0  # waves and foam are so much longer along the flow
_WAVE_PER_M = 1 / 0.05
_FOAM_PER_M = 1 / 0.10
_RAGGED_PER_M = 1 / 0.12
_GROWTH_PER_M = 1 / 0.06
_FINE_PER_M = 1 / 0.012
_ONE = 1 / 32.0  # a texel's standard deviation
_FOAM = (214.0, 226.0, 228.0)
_MUD = (92.0, 118.0, 140.0)
_GREEN = (48.0, 112.0, 84.0)
_DRY = (96.0, 150.0, 168.0)
_SUN = (250.0, 252.0, 255.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Waterside:
    """How a river and its banks look.

    Attributes:
        water_bgr: Colour of the water itself.
        waves: Share of brightness by one standard deviation of the waves.
        foam: Share of the water under foam, in streaks.
        mirror: Share of the sky's light that the water mirrors, where it is looked at from straight above; more at an
            angle (Schlick's approximation).
        glare: Strength of the sun's glitter; 0 for none.
        shade_m: How far the left bank's trees throw their shade over the water, on average; 0 for none.
        shade_light: Share of the light that is left in the shade.
        mud_m: Width of the bare margin along the water.
        growth: Contrast of the banks' growth; 1 for meadow, 2 for thicket.
    """

    water_bgr: tuple[float, float, float] = (104.0, 82.0, 52.0)
    waves: float = 0.1
    foam: float = 0.0
    mirror: float = 0.03
    glare: float = 0.0
    shade_m: float = 0.0
    shade_light: float = 0.45
    mud_m: float = 0.0
    growth: float = 1.0

    def numbers(self, sun_azimuth_rad: float, sun_elevation_rad: float) -> tuple[float, ...]:
        """As the loop takes them: the attributes in order, then the unit vector to the sun (ENU)."""
        flat = math.cos(sun_elevation_rad)
        sun = (flat * math.sin(sun_azimuth_rad), flat * math.cos(sun_azimuth_rad), math.sin(sun_elevation_rad))
        threshold = 4.0 if self.foam <= 0 else _quantile(1.0 - self.foam)
        return (
            *map(float, self.water_bgr),
            self.waves,
            threshold,
            self.mirror,
            self.glare,
            self.shade_m,
            self.shade_light,
            self.mud_m,
            self.growth,
            *sun,
        )


def _quantile(share: float) -> float:
    """Of the normal distribution, as close as streaks of foam need it (Tukey's lambda)."""
    return 4.91 * (math.pow(share, 0.14) - math.pow(1.0 - share, 0.14))


@njit_inline
def _shade(along: float, inland: float, tiles: Tiles, sides: tuple[float, ...], footprint: float) -> float:
    """Share of the light; ``inland`` is how far a place is from the left bank, on land above 0."""
    if sides[7] <= 0.0:
        return 1.0
    level = np.log2(max(footprint, 0.3) * _RAGGED_PER_M)
    ragged = sample(tiles[1], tiles[3], along * _RAGGED_PER_M, 7.0, level) * _ONE
    crown = sample(tiles[0], tiles[3], along * _RAGGED_PER_M * 3.0, inland * _RAGGED_PER_M * 3.0, level + 1.6) * _ONE
    reach = max(sides[7] * (1.0 + 0.5 * ragged) + 0.4 * crown, 0.0)
    dark = min(max((inland + reach) / 0.3, 0.0), 1.0) * min(max((4.0 - inland) / 0.3, 0.0), 1.0)
    light: float = 1.0 - dark * (1.0 - sides[8])
    return light


@njit_inline
def _water_colour(k: int, lights: tuple[float, float, float, float], sides: tuple[float, ...]) -> float:
    """Of one channel; ``lights`` are the waves' brightness (1 on average), foam, mirrored share and glitter."""
    wave, foam, mirrored, glitter = lights
    colour = sides[k] * wave
    colour += foam * (_FOAM[k] - colour)
    colour += mirrored * (SKY[k] - colour)
    return float(colour + glitter * (_SUN[k] - colour))


@njit_inline
def _water_lights(
    along: float,
    across: float,
    down: float,
    toward_sun: float,
    footprint: float,
    tiles: Tiles,
    sides: tuple[float, ...],
) -> tuple[float, float, float, float]:
    """See ``_water_colour``; cosines of the view's incidence, and between the mirrored ray and the sun."""
    starts = tiles[3]
    level = np.log2(footprint * _WAVE_PER_M)
    wave = sample(tiles[2], starts, along * _WAVE_PER_M / _STRETCH, across * _WAVE_PER_M, level) * _ONE
    level = np.log2(footprint * _FOAM_PER_M)
    streak = sample(tiles[1], starts, along * _FOAM_PER_M / _STRETCH, across * _FOAM_PER_M, level) * _ONE
    foam = min(max((streak - sides[4]) * 2.0, 0.0), 1.0)
    slant = 1.0 - down
    mirrored = min(max(sides[5] + (1.0 - sides[5]) * slant**5 + 0.12 * sides[5] * wave, 0.0), 0.9)
    glitter = 0.0
    if sides[6] > 0.0 and toward_sun > 0.0:
        glitter = min(max(sides[6] * toward_sun**40 * (1.0 + 1.2 * wave), 0.0), 1.0)
    return 1.0 + sides[3] * wave, foam, mirrored, glitter


@njit_inline
def _growth(east: float, north: float, footprint: float, tiles: Tiles) -> tuple[float, float]:
    """What grows on land: clumps and blades, in standard deviations."""
    starts = tiles[3]
    level = np.log2(footprint * _GROWTH_PER_M)
    clump = sample(tiles[1], starts, east * _GROWTH_PER_M, north * _GROWTH_PER_M, level) * _ONE
    level = np.log2(footprint * _FINE_PER_M)
    blade = sample(tiles[0], starts, east * _FINE_PER_M, north * _FINE_PER_M, level) * _ONE
    return clump, blade


@njit_inline
def _land_colour(k: int, clump: float, blade: float, dry: float, growth: float) -> float:
    """Of one channel; ``dry`` is the distance from the water in widths of its bare margin."""
    green = min(max(0.6 + 0.4 * clump, 0.0), 1.0)
    colour = _DRY[k] + green * (_GREEN[k] - _DRY[k])
    colour *= max(1.0 + growth * (0.16 * clump + 0.14 * blade), 0.1)
    bare = min(max(1.0 - (dry - 1.0) / 0.3, 0.0), 1.0)
    return float(colour + bare * (_MUD[k] * (1.0 + 0.06 * blade + 0.05 * clump) - colour))


@njit
def shade_waterside(
    rays: Rays,
    camera: CameraState,
    waterway: tuple[RiverFrame, FloatArray],
    look: Appearance,
    sides: tuple[float, ...],
    tiles: Tiles,
    image: ImageArray,
) -> None:
    """As ``shading.shade``, with the ways of a ``Waterside``.

    Args:
        rays: See there.
        camera: See there.
        waterway: The river's frame and its banks.
        look: See there.
        sides: ``Waterside.numbers``.
        tiles: See there.
        image: ``(h, w, 3)`` BGR, written.
    """
    river, banks = waterway
    for v in range(rays.shape[0]):
        for u in range(rays.shape[1]):
            reach, east, north, moved, footprint, along, across = trace_ground(rays, v, u, camera, river)
            if reach == 0.0:
                paint_sky(rays, v, u, image)
                continue
            slant = np.sqrt(east * east + north * north + camera[2] * camera[2])
            toward_sun = (east * sides[11] + north * sides[12] + camera[2] * sides[13]) / slant
            down = camera[2] / slant
            east += camera[0]
            north += camera[1]
            wet = water_fraction(along, across, moved, footprint, banks, river)
            gap, _ = gap_to_bank(along, across, banks, river[4], river[5])
            index = int(min(max((along - river[4]) / river[5], 0.0), banks.shape[0] - 1.001))
            light = _shade(along, across - banks[index, 0], tiles, sides, footprint)
            lights, growth = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0)
            if wet > 0.0:
                drifted = along - look[2] * camera[14]
                lights = _water_lights(drifted, across, down, toward_sun, footprint, tiles, sides)
            if wet < 1.0:
                growth = _growth(east, north, footprint, tiles)
            clear = 1.0 / (1.0 + reach * reach * HAZE_PER_M2)
            dry = 9.0 if sides[9] <= 0.0 else max(-gap, 0.0) / sides[9]
            for k in range(3):
                colour = light * _land_colour(k, growth[0], growth[1], dry, sides[10]) if wet < 1.0 else 0.0
                if wet > 0.0:
                    colour += wet * (light * _water_colour(k, lights, sides) - colour)
                colour = SKY[k] + clear * (colour - SKY[k])
                image[v, u, k] = np.uint8(min(max(colour + 0.5, 0.0), 255.0))


class WatersideRenderer(Renderer):
    """A renderer of rivers as they look in earnest; without a waterside plain water between plain banks."""

    def __init__(self, camera, world, imaging=None, waterside=None):
        super().__init__(camera, world, imaging)
        self._waterside = waterside

    def _background(self, state, image):
        if self._waterside is None:
            super()._background(state, image)
            return
        look = self.world.look
        looks = (look.ground_contrast, look.water_contrast, self.world.river.flow_mps)
        sides = self._waterside.numbers(look.sun_azimuth_rad, look.sun_elevation_rad)
        shade_waterside(self._rays, state, (self._river, self._banks), looks, sides, self._tiles, image)
