"""Simulated flights with known truth: what a camera would see, and what an autopilot would say."""
