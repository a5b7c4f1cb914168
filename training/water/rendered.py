"""Rivers and roads that nobody photographed: textures of labelled photographs, laid on a plane that a camera looks at.

What photographs lack is drawn: the view from straight above, stony and bare banks, canals between walls, and roads,
which are as even and as straight as a canal and are no water.
"""

import math

import cv2
import numpy as np
import numpy.typing as npt
from pictures import Bytes, Labelled

from aerodft.dft.maps import GroundMap
from aerodft.geometry import camera_pose
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import Appearance, Island, River, furnished_world

Floats = npt.NDArray[np.float32]
DRAWN = 0.4
"""Of the land that is rendered, so much has a texture of noise in two colours in place of a photograph's."""
_PATCH_PX = 160
_TILE_PX = 512


class Painter:
    """Draws rivers and roads with the textures of pictures.

    Args:
        pictures: Whose land and water are taken.
        random: What is drawn from.
    """

    def __init__(self, pictures: list[Labelled], random: np.random.Generator) -> None:
        self._random = random
        patches: tuple[list[Bytes], list[Bytes]] = [], []
        for picture in pictures:
            for wet, found in enumerate(patches):
                found.extend(_patches(picture, wet=bool(wet), random=random))
        self._land, self._water = patches

    def picture(self, width_px: int, height_px: int, *, road: bool) -> tuple[Bytes, Bytes]:
        """A river (or a road, without water), and where its water is: ``(h, w, 3)`` BGR and ``(h, w)`` 0 or 255."""
        random = self._random
        tilt = math.radians(random.choice([0.0, random.uniform(0, 30), random.uniform(30, 72)]))
        right, away = _plane(width_px, height_px, tilt, random)
        width = random.uniform(0.2, 0.95) if not road else random.uniform(0.06, 0.2)
        turned = random.uniform(-1.2, 1.2) if tilt > 0.6 else random.uniform(-math.pi, math.pi)
        middle = float(np.median(away))
        across = (right - random.uniform(-0.3, 0.3)) * math.cos(turned) + (away - middle) * math.sin(turned)
        along = (away - middle) * math.cos(turned) - right * math.sin(turned)
        bend = random.uniform(0, 0.25) * (random.random() < (0.25 if road else 0.7))
        ragged = self._noise(right, away, 0.02 * random.uniform(0, 1) ** 2 if not road else 0.003)
        beyond = np.abs(across - bend * np.sin(along * random.uniform(1, 4))) - width / 2 + ragged
        if not road and random.random() < 0.25:  # one bank
            beyond = across + bend * np.sin(along * random.uniform(1, 4)) + ragged
        return self._composed(beyond.astype(np.float32), right, away, road=road)

    def _composed(self, beyond: Floats, right: Floats, away: Floats, *, road: bool) -> tuple[Bytes, Bytes]:
        """A picture whose water (or road) is where ``beyond`` is below 0."""
        random = self._random
        land = self._laid(self._land, right, away, DRAWN)
        if random.random() < 0.6:  # a margin of another kind: stones, mud, a wall
            margin = random.uniform(0.01, 0.12)
            land = np.where((beyond < margin)[..., None], self._laid(self._land, right, away, DRAWN), land)
        if road:
            surface = self._road(beyond, right, away)
        else:
            plain = random.random() < 0.45
            surface = self._plain_water(right, away) if plain else self._laid(self._water, right, away)
            if random.random() < 0.4:  # the bank's shade or mirror image
                shade = np.exp(np.minimum(beyond, 0) / random.uniform(0.02, 0.15)) * random.uniform(0.2, 0.6)
                surface = surface * (1 - shade[..., None])
        edge = random.uniform(0.6, 1.6)
        inside = (beyond < 0).astype(np.float32)
        soft = cv2.GaussianBlur(inside, (0, 0), edge)[..., None]
        picture = surface * soft + land * (1 - soft)
        water = np.zeros(beyond.shape, np.uint8) if road else (255 * inside).astype(np.uint8)
        return np.clip(picture, 0, 255).astype(np.uint8), water

    def _plain_water(self, right: Floats, away: Floats) -> Floats:
        """Water of one colour, from black over brown and grey to milky green, with ripples or as smooth as glass."""
        random = self._random
        hue, saturation, light = random.uniform(10, 115), random.uniform(0, 170), random.uniform(25, 220)
        colour = cv2.cvtColor(np.array([[[hue, saturation, light]]], dtype=np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
        ripples = self._noise(right * 3, away * 9, random.uniform(0, 0.12) ** 1.5)
        slow = self._noise(right / 4, away / 4, random.uniform(0, 0.12))
        return np.asarray(colour * (1 + ripples + slow)[..., None], dtype=np.float32)

    def with_other_water(self, pixels: Bytes, water: Bytes) -> Bytes:
        """A photograph whose water is that of another photograph, or of one colour, in the light that it had."""
        random = self._random
        height, width = water.shape
        right, away = _plane(width, height, math.radians(random.uniform(0, 70)), random)
        plain = random.random() < 0.5
        other = self._plain_water(right, away) if plain else self._laid(self._water, right, away)
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY).astype(np.float32)
        light = cv2.GaussianBlur(grey, (0, 0), random.uniform(1, 12))
        light = light / max(float(light[water > 127].mean()), 10.0) if (water > 127).any() else light / 128
        share = cv2.GaussianBlur(water.astype(np.float32) / 255, (0, 0), 1.2)[..., None] * random.uniform(0.6, 1)
        lit = other * (light ** random.uniform(0, 1))[..., None]
        return np.clip(pixels * (1 - share) + lit * share, 0, 255).astype(np.uint8)

    def with_road(self, pixels: Bytes, water: Bytes) -> tuple[Bytes, Bytes]:
        """A photograph with a road drawn across it, and its water, less what the road covers."""
        random = self._random
        height, width = water.shape
        tilt = math.radians(random.uniform(0, 60))
        right, away = _plane(width, height, tilt, random)
        turned = random.uniform(-math.pi, math.pi)
        across = (right - random.uniform(-0.4, 0.4)) * math.cos(turned) + (away - np.median(away)) * math.sin(turned)
        beyond = np.abs(across) - random.uniform(0.03, 0.15)
        inside = cv2.GaussianBlur((beyond < 0).astype(np.float32), (0, 0), random.uniform(0.6, 1.4))
        surface = self._road(beyond.astype(np.float32), right, away)
        drawn = surface * inside[..., None] + pixels * (1 - inside[..., None])
        return np.clip(drawn, 0, 255).astype(np.uint8), np.where(inside > 0.5, 0, water).astype(np.uint8)

    def _road(self, beyond: Floats, right: Floats, away: Floats) -> Floats:
        """Asphalt, concrete or gravel, as even as water; most with lines along them, many with vehicles."""
        random = self._random
        grey = random.uniform(60, 200) * np.array([1, 1, 1]) * random.uniform(0.92, 1.08, 3)
        surface = np.broadcast_to(grey, (*beyond.shape, 3)) + self._noise(right, away, random.uniform(2, 8))[..., None]
        for _ in range(random.integers(1, 4)):  # what divides the lanes, and their edges
            line = np.abs(beyond - random.uniform(beyond.min(), 0)) < random.uniform(0.002, 0.007)
            if random.random() < 0.4:  # dashed
                line &= np.sin((right + away) * random.uniform(30, 120)) > 0
            surface = np.where(line[..., None], random.uniform(170, 250), surface)
        for _ in range(random.integers(0, 7) if random.random() < 0.5 else 0):  # vehicles
            row, column = (random.integers(side) for side in beyond.shape)
            length, width = random.uniform(0.02, 0.06), random.uniform(0.01, 0.025)
            at = np.abs(right - right[row, column]) < width, np.abs(away - away[row, column]) < length
            surface = np.where((at[0] & at[1])[..., None], random.uniform(10, 250, 3), surface)
        return np.asarray(surface, dtype=np.float32)

    def _laid(self, patches: list[Bytes], right: Floats, away: Floats, drawn: float = 0.0) -> Floats:
        """A texture on the plane: of a photograph, or, in a share ``drawn`` of all cases, one that nobody took."""
        random = self._random
        patch = _grown(random) if random.random() < drawn else patches[random.integers(len(patches))]
        tile = np.vstack([np.hstack([patch, patch[:, ::-1]]), np.hstack([patch[::-1], patch[::-1, ::-1]])])
        tile = np.ascontiguousarray(cv2.resize(tile, (_TILE_PX, _TILE_PX)))
        scale = _TILE_PX * random.uniform(0.8, 2.5)
        x, y = (each * np.float32(scale) + np.float32(random.uniform(0, _TILE_PX)) for each in (right, away))
        laid = cv2.remap(tile, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        light = 1 + self._noise(right / 3, away / 3, random.uniform(0, 0.15))
        return np.asarray(laid * light[..., None], dtype=np.float32)

    def _noise(self, right: Floats, away: Floats, strength: float) -> Floats:
        tile = cv2.resize(self._random.standard_normal((24, 24)).astype(np.float32), (_TILE_PX, _TILE_PX))
        fine = cv2.resize(self._random.standard_normal((96, 96)).astype(np.float32), (_TILE_PX, _TILE_PX))
        x, y = right * np.float32(300), away * np.float32(300)
        laid = cv2.remap(tile + 0.5 * fine, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(strength * laid, dtype=np.float32)


def _plane(width_px: int, height_px: int, tilt: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Where each pixel meets the plane, right and ahead, in about picture widths near the middle."""
    focal = width_px * random.uniform(0.7, 1.4)
    u, v = np.meshgrid(np.arange(width_px) - width_px / 2, np.arange(height_px) - height_px / 2)
    down = np.maximum(math.cos(tilt) - v / focal * -math.sin(tilt), 0.06)
    near = focal / width_px / math.cos(tilt) ** 0.5
    right = u / focal / down * near
    ahead = (math.sin(tilt) + v / focal * -math.cos(tilt)) / down * near
    return right.astype(np.float32), ahead.astype(np.float32)


def _grown(random: np.random.Generator) -> Bytes:
    """A square of two natural colours, mixed and shaded by noise of many sizes, at times with dark bushes."""
    hue, saturation, light = random.uniform(8, 70), random.uniform(5, 160), random.uniform(60, 210)
    near = np.clip([hue, saturation, light] + random.normal(0, [8, 25, 25]), 0, [179, 255, 255])
    hsv = np.array([[[hue, saturation, light], near]]).astype(np.uint8)
    first, second = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0].astype(np.float32)
    steep = random.uniform(0.55, 0.95)
    fields = []
    for _ in range(3):
        total = np.zeros((_PATCH_PX, _PATCH_PX), np.float32)
        for octave in range(6):
            cells = random.standard_normal((5 << octave, 5 << octave)).astype(np.float32)
            total += steep**octave * cv2.resize(cells, (_PATCH_PX, _PATCH_PX), interpolation=cv2.INTER_AREA)
        fields.append(total / total.std())
    mixed = np.clip(0.5 + fields[0] * random.uniform(0.2, 1), 0, 1)[..., None]
    shaded = (1 + random.uniform(0.05, 0.3) * fields[1])[..., None]
    ground = (first * mixed + second * (1 - mixed)) * shaded
    if random.random() < 0.4:
        bush = random.uniform(0.2, 0.6) * first * [1, random.uniform(1, 1.3), 1]
        ground = np.where((fields[2] > random.uniform(0.7, 1.6))[..., None], bush * shaded, ground)
    return np.clip(ground, 0, 255).astype(np.uint8)


def _patches(picture: Labelled, *, wet: bool, random: np.random.Generator) -> list[Bytes]:
    """Some squares of water, or of land, in the lower two thirds: above there is sky."""
    wanted = (picture.water > 127) == wet
    height, width = wanted.shape
    found: list[Bytes] = []
    for _ in range(12):
        top = int(random.integers(min(height // 3, height - _PATCH_PX - 1), height - _PATCH_PX))
        left = int(random.integers(0, width - _PATCH_PX))
        square = np.s_[top : top + _PATCH_PX, left : left + _PATCH_PX]
        if wanted[square].mean() > 0.995 and len(found) < 3:
            found.append(picture.pixels[square])
    return found


def simulated(count: int, random: np.random.Generator) -> list[Labelled]:
    """Pictures of the simulator's rivers, from straight above to 70 degrees, with islands and without."""
    camera = default_camera(768, 432)
    u, v = np.meshgrid(np.arange(768.0), np.arange(432.0))
    found = []
    for number in range(count):
        islands = (Island(station_m=random.uniform(0, 60), length_m=30.0, width_m=5.0),) if number % 3 == 0 else ()
        river = River(
            width_m=random.uniform(10, 40), width_swing_m=random.uniform(0, 3), meander_m=random.uniform(0, 8),
            islands=islands, azimuth_rad=random.uniform(0, 6),
        )  # fmt: skip
        look = Appearance(ground_contrast=random.uniform(0.5, 1.5), water_contrast=random.uniform(0.5, 2.0))
        world = furnished_world(river, seed=1000 + number, look=look)
        east, north, _ = river.enu(random.uniform(-60, 60), random.uniform(-15, 15))
        pose = camera_pose(
            height_agl_m=random.uniform(15, 90), tilt_rad=random.choice([0.0, random.uniform(0, 1.2)]),
            roll_rad=random.uniform(-0.1, 0.1),
            heading_rad=random.uniform(-3, 3), east_m=float(east), north_m=float(north),
        )  # fmt: skip
        pixels = Renderer(camera, world, SensorModel(seed=number)).render(pose, random.uniform(0, 30))
        points = GroundMap.at(camera, pose, 0.0).points_enu_m(np.stack([u, v], axis=-1))
        along, across = river.along_across(points)
        (left, right), (shore_left, shore_right) = river.banks_m(along), river.shores_m(along)
        with np.errstate(invalid="ignore"):
            wet = (across < left) & (across > right) & ~((across < shore_left) & (across > shore_right))
        found.append(Labelled(f"simulated/{number}", pixels, 255 * wet.astype(np.uint8), is_exact=True))
    return found
