"""Simulated flights with known truth: images of a camera and MAVLink of an autopilot."""

from aerodft.sim.scenario import default_camera
from aerodft.sim.telemetry import DEFAULT_RATES_HZ, Autopilot, datagrams
from aerodft.sim.trajectory import Waypoint, fly
