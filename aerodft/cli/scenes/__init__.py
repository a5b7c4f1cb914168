"""Commands about images and scenes: measured, surveyed, calibrated."""
