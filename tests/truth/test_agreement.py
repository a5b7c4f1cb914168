"""What is measured, against points that OpenCV projected and against the paper's equations written out here."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, LensModel, PoseSample, Probe, ProbeKind, ProjectionModel, Status
from tests.commands import run_aerodft
from tests.nights import at_night
from tests.one_image import measure

from .scenes import as_pixels, camera_axes, opencv_matrix, opencv_pixels

MICROMETRE = 1e-6
WORLDS = [40, *at_night(400)]
"""How many are drawn. What is wrong is wrong by more than a micrometre in most of them."""
WIDTH_PX, HEIGHT_PX = 1920, 1080
COEFFICIENTS = {  # bounds of each, up to strong lenses
    "none": (),
    "brown 4": (0.25, 0.08, 0.003, 0.003),
    "brown 5": (0.25, 0.08, 0.003, 0.003, 0.02),
    "rational": (0.3, 0.1, 0.003, 0.003, 0.02, 0.3, 0.1, 0.02),
    "fisheye": (0.1, 0.03, 0.01, 0.003),
}
KINDS = {
    "position": (ProbeKind.POSITION, ["a"]),
    "range": (ProbeKind.RANGE, ["b"]),
    "distance": (ProbeKind.DISTANCE, ["a", "b"]),
    "width": (ProbeKind.WIDTH, ["raised a", "raised b"]),
    "length": (ProbeKind.LENGTH, ["a", "b", "c"]),
    "area": (ProbeKind.AREA, ["a", "b", "c"]),
    "height": (ProbeKind.HEIGHT, ["a", "top"]),
    "bearing": (ProbeKind.BEARING, ["c"]),
    "bearing-of-two": (ProbeKind.BEARING, ["a", "c"]),
}

angle = st.floats(-math.pi, math.pi)
share = st.floats(-1, 1)


@dataclass(frozen=True, slots=True)
class World:
    """A camera over level ground, points by name (``raised`` ones on a plane at ``elevation_m``), and their pixels."""

    camera: Camera
    tilt_rad: float
    roll_rad: float
    heading_rad: float
    position_m: np.ndarray
    elevation_m: float
    points_m: dict
    pixels_px: dict

    def pixels(self, name):
        return as_pixels([self.pixels_px[point] for point in KINDS[name][1]])

    def answers(self, model):
        east, north, height = self.position_m
        pose = camera_pose(
            height_agl_m=height, tilt_rad=self.tilt_rad, roll_rad=self.roll_rad, heading_rad=self.heading_rad,
            east_m=east, north_m=north,
        )  # fmt: skip
        requests = []
        for name, (kind, _) in KINDS.items():
            elevation = self.elevation_m if name == "width" else 0.0
            probe = Probe(name=name, kind=kind, pixels=self.pixels(name), elevation_m=elevation)
            requests.append(Request(probe=probe, pixels=self.pixels(name), std_px=1e-3))
        sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
        answers = measure(Setup(camera=self.camera, model=model), sample, tuple(requests))
        assert {answer.name: answer.status for answer in answers} == dict.fromkeys(KINDS, Status.OK)
        return {answer.name: (answer.value, answer.enu_m) for answer in answers}

    def truths(self):
        """By name; ``area`` in m^2, bearings in rad."""
        a, b, c = (self.points_m[name] for name in "abc")
        (ux, uy, _), (vx, vy, _) = b - a, c - a
        away = c - self.position_m
        return {
            "position": None,
            "range": math.dist(b, self.position_m),
            "distance": math.dist(a, b),
            "width": math.dist(self.points_m["raised a"], self.points_m["raised b"]),
            "length": math.dist(a, b) + math.dist(b, c),
            "area": abs(ux * vy - uy * vx) / 2,
            "height": self.points_m["top"][2],
            "bearing": math.atan2(away[0], away[1]),
            "bearing-of-two": math.atan2(vx, vy),
        }

    def assert_found(self, answers):
        """``answers`` by name: value and ENU points."""
        a, b, c = (self.points_m[name] for name in "abc")
        lever = {"bearing": math.dist(c[:2], self.position_m[:2]), "bearing-of-two": math.dist(a, c)}
        around = math.dist(a, b) + math.dist(b, c) + math.dist(c, a)
        for name, truth in self.truths().items():
            value, enu = answers[name]
            if name == "bearing":
                assert enu is None
            else:
                assert_allclose(
                    enu, [self.points_m[point] for point in KINDS[name][1]], atol=MICROMETRE, rtol=0, err_msg=name
                )
            if name in lever:  # sideways, at the far end
                off = (value - math.degrees(truth) + 180) % 360 - 180
                assert abs(math.radians(off)) * lever[name] < MICROMETRE, name
            elif truth is None:
                assert value is None
            else:  # an area is a strip along its boundary off
                assert_allclose(value, truth, atol=MICROMETRE * (around if name == "area" else 1), rtol=0, err_msg=name)


@st.composite
def cameras(draw, lens):
    focal = draw(st.floats(1000, 3000))
    return Camera(
        name="c", width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=focal, fy_px=focal * draw(st.floats(0.8, 1.25)),
        cx_px=960 + 200 * draw(share), cy_px=540 + 150 * draw(share),
        lens=LensModel.FISHEYE if lens == "fisheye" else LensModel.BROWN,
        distortion=tuple(bound * draw(share) for bound in COEFFICIENTS[lens]),
    )  # fmt: skip


@st.composite
def worlds(draw, lens):
    """Three ground points, of which the first is drawn by pixel and depression, and the others are not above it."""
    camera = draw(cameras(lens))
    first = np.array([draw(st.floats(400, 1520)), draw(st.floats(250, 830))])
    apart = np.array([[draw(st.floats(20, 380)), 220 * draw(share)], [380 * draw(share), draw(st.floats(20, 220))]])
    pixels = np.vstack([first, first + apart, first - apart])  # undistorted ones
    rays = np.column_stack([pixels, np.ones(5)]) @ np.linalg.inv(opencv_matrix(camera)).T
    roll, heading = draw(angle), draw(angle)
    x, y, z = rays[0]
    lower = math.sin(roll) * x + math.cos(roll) * y
    most = math.hypot(lower, z)
    sine = min(math.sin(draw(st.floats(math.radians(2), math.pi / 2))) * math.hypot(x, y, z) / most, 1.0)
    tilt = math.atan2(lower, z) + math.acos(sine)
    axes = camera_axes(tilt, roll, heading)
    rays_enu = rays @ axes.T
    rays_enu = np.array([rays_enu[0], *(min(rays_enu[i], rays_enu[i + 2], key=lambda ray: ray[2]) for i in (1, 2))])
    assume(np.all(rays_enu[:, 2] < -0.02))

    height = draw(st.floats(2, 300))
    elevation = height * draw(st.floats(-0.5, 0.5))
    position = np.array([1000 * draw(share), 1000 * draw(share), height])
    a, b, c = position - height * rays_enu / rays_enu[:, 2:]
    raised = position - (height - elevation) * rays_enu[:2] / rays_enu[:2, 2:]
    top = a + [0, 0, draw(st.floats(0.01, 0.1)) * math.dist(a, position)]
    points = {"a": a, "b": b, "c": c, "raised a": raised[0], "raised b": raised[1], "top": top}
    assume(is_one_to_one(camera, (np.array([*points.values()]) - position) @ axes))
    found = opencv_pixels(camera, axes, position, [*points.values()])
    assume(np.all((found > 0) & (found < [WIDTH_PX - 1, HEIGHT_PX - 1])))
    return World(camera, tilt, roll, heading, position, elevation, points, dict(zip(points, found, strict=True)))


def is_one_to_one(camera, seen_cam):
    """Whether the lens model is increasing from its axis out to all of these, which must be in front of the camera."""
    if np.any(seen_cam[:, 2] < 0.3 * np.linalg.norm(seen_cam, axis=1)):
        return False
    farthest = np.max(np.hypot(seen_cam[:, 0], seen_cam[:, 1]) / seen_cam[:, 2])
    s = np.linspace(0, 1.1 * farthest, 200)
    if camera.lens is LensModel.FISHEYE:
        k = camera.distortion
        s = np.arctan(s)
        radius = s * (1 + k[0] * s**2 + k[1] * s**4 + k[2] * s**6 + k[3] * s**8)
    else:
        k1, k2, _, _, k3, k4, k5, k6 = (*camera.distortion, *(0,) * 8)[:8]
        under = 1 + k4 * s**2 + k5 * s**4 + k6 * s**6
        radius = s * (1 + k1 * s**2 + k2 * s**4 + k3 * s**6) / under
        if np.any(under < 0.1):
            return False
    return bool(np.all(np.diff(radius) > 0.1 * np.diff(s)))


@pytest.mark.parametrize("count", WORLDS)
@pytest.mark.parametrize("lens", COEFFICIENTS)
def test_what_opencv_projects_is_measured(lens, count):
    @settings(max_examples=count, deadline=None)
    @given(worlds(lens))
    def assert_found(world):
        world.assert_found(world.answers(ProjectionModel.PINHOLE))

    assert_found()


def paper_world(fov_rad, tilt_rad, heading_rad, position, elevation_m, pixels):
    """Eq. 2 to 8 for pixels, written out; None where the object ends below the ground, or two points are in one."""
    hfov, vfov = fov_rad
    foot, height = np.array(position[:2]), position[2]
    ahead_en, right_en = np.array(
        [[math.sin(heading_rad), math.cos(heading_rad)], [math.cos(heading_rad), -math.sin(heading_rad)]]
    )
    points, ahead = {}, {}
    for name, (i, j) in pixels.items():
        up = elevation_m if "raised" in name else 0.0
        phi = (i - WIDTH_PX / 2) * hfov / WIDTH_PX
        psi = tilt_rad + (HEIGHT_PX / 2 - j) * vfov / HEIGHT_PX
        ahead[name] = (height - up) * math.tan(psi)
        points[name] = np.array([*(foot + ahead[name] * (ahead_en + math.tan(phi) * right_en)), up])
    a, b, c = (points[name] for name in "abc")
    if abs(ahead["top"]) < 1e-2 * height or ahead["a"] / ahead["top"] >= 1:
        return None
    points["top"] = a + [0, 0, height * (ahead["top"] - ahead["a"]) / ahead["top"]]
    if min(math.dist(a, b), math.dist(b, c), math.dist(c, a), math.dist(c[:2], foot)) < 1e-2:
        return None
    (ux, uy, _), (vx, vy, _) = b - a, c - a
    if abs(ux * vy - uy * vx) < 1e-6 * max(math.dist(a, b), math.dist(c, a)) ** 2:  # three corners in a line
        return None
    camera = Camera.from_fov(name="c", width_px=WIDTH_PX, height_px=HEIGHT_PX, hfov_rad=hfov, vfov_rad=vfov)
    return World(camera, tilt_rad, 0.0, heading_rad, np.array(position), elevation_m, points, pixels)


@st.composite
def paper_worlds(draw):
    fov = draw(st.floats(0.3, 1.5)), draw(st.floats(0.2, 1.0))
    tilt = draw(st.floats(0, math.radians(88)))
    position = 1000 * draw(share), 1000 * draw(share), draw(st.floats(2, 300))
    elevation = position[2] * draw(st.floats(-0.5, 0.5))
    rows = st.floats(max(0.0, HEIGHT_PX / 2 - (math.radians(88) - tilt) * HEIGHT_PX / fov[1]), HEIGHT_PX - 1)
    top, base = sorted([draw(rows), draw(rows)])
    at_row = {"a": base, "b": draw(rows), "c": draw(rows), "top": top}
    pixels = {name: (draw(st.floats(0, WIDTH_PX - 1)), row) for name, row in at_row.items()}
    pixels |= {"raised a": pixels["b"], "raised b": pixels["c"]}
    world = paper_world(fov, tilt, draw(angle), position, elevation, pixels)
    assume(world is not None)
    return world


@pytest.mark.parametrize("count", WORLDS)
def test_what_the_paper_says_is_measured(count):
    @settings(max_examples=count, deadline=None)
    @given(paper_worlds())
    def assert_found(world):
        world.assert_found(world.answers(ProjectionModel.DFT))

    assert_found()


def command_line(world, model, folder):
    """What ``aerodft measure --json`` prints of a world: value and ENU points by name; the foot is the origin."""
    camera = world.camera
    path = folder / "camera.toml"
    path.write_text(f"""
name = "c"
width_px = {camera.width_px}
height_px = {camera.height_px}
fx_px = {camera.fx_px!r}
fy_px = {camera.fy_px!r}
cx_px = {camera.cx_px!r}
cy_px = {camera.cy_px!r}
lens = "{camera.lens}"
distortion = {[*camera.distortion]}
""")
    angles = {"--tilt": world.tilt_rad, "--roll": world.roll_rad, "--heading": world.heading_rad}
    arguments = [f"{option}={math.degrees(radians)!r}" for option, radians in angles.items()]
    for name, (kind, _) in KINDS.items():
        pixels = " ".join(f"{u!r},{v!r}" for u, v in world.pixels(name))
        elevation = f" elevation={world.elevation_m!r}" if name == "width" else ""
        arguments += ["--probe", f"{kind} {pixels}{elevation} name={name}"]
    given = ["--camera", path, f"--height={world.position_m[2]}", "--std", "height=0.01,attitude=0.01,px=0.01"]
    ran = run_aerodft("measure", *given, "--model", model, "--json", *arguments)
    assert ran.code == 0, ran.err
    answers = ran.json
    assert {answer["name"]: answer["status"] for answer in answers} == dict.fromkeys(KINDS, "ok")
    return {answer["name"]: (answer["value"], answer["enu_m"]) for answer in answers}


def given_world(lens):
    """One that was drawn by hand, with all that can be different from 0 different from 0."""
    distortion = tuple(bound * part for bound, part in zip(COEFFICIENTS[lens], (-0.6, 0.8) * 4, strict=False))
    camera = Camera(
        name="c", width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=1510.0, fy_px=1460.0, cx_px=985.5, cy_px=501.25,
        lens=LensModel.FISHEYE if lens == "fisheye" else LensModel.BROWN, distortion=distortion,
    )  # fmt: skip
    tilt, roll, heading, position = 1.1, -0.31, 2.4, np.array([0.0, 0.0, 41.3])
    axes = camera_axes(tilt, roll, heading)
    rays = np.array([[-0.2, 0.05, 1], [0.15, 0.12, 1], [0.05, 0.25, 1]]) @ axes.T
    a, b, c = position - position[2] * rays / rays[:, 2:]
    raised = position - (position[2] - 3.7) * rays[:2] / rays[:2, 2:]
    points = {"a": a, "b": b, "c": c, "raised a": raised[0], "raised b": raised[1], "top": a + [0, 0, 6.5]}
    assert is_one_to_one(camera, (np.array([*points.values()]) - position) @ axes)
    pixels = opencv_pixels(camera, axes, position, [*points.values()])
    return World(camera, tilt, roll, heading, position, 3.7, points, dict(zip(points, pixels, strict=True)))


@pytest.mark.parametrize("lens", COEFFICIENTS)
def test_the_command_line_measures_what_opencv_projects(lens, tmp_path):
    world = given_world(lens)
    world.assert_found(command_line(world, "pinhole", tmp_path))


def test_the_command_line_measures_what_the_paper_says(tmp_path):
    pixels = {"a": (1200.0, 900.5), "b": (700.25, 640.0), "c": (300.0, 310.0), "top": (1190.0, 420.0)}
    pixels |= {"raised a": pixels["b"], "raised b": pixels["c"]}
    world = paper_world((1.12, 0.79), 1.05, -0.8, (0.0, 0.0, 10.48), 1.7, pixels)
    world.assert_found(command_line(world, "dft", tmp_path))
