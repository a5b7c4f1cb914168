"""Simulated flights with known truth: what a camera would see, and what an autopilot would say."""

from aerodft.sim.scenario import default_camera
from aerodft.sim.telemetry import DEFAULT_RATES_HZ, Autopilot, datagrams
from aerodft.sim.trajectory import Waypoint, fly
