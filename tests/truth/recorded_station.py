"""The station that recorded flights are imported with."""


def station(*, rate_hz: float, heights: str = '["rangefinder", "terrain", "home"]') -> str:
    """Its configuration: a camera whose middle is measured, at a rate, by these sources of height in order."""
    return f"""
[station]
name = "truth"
[camera]
name = "1080p"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
vfov_deg = 36.0
[telemetry.height]
order = {heights}
[images]
rate_hz = {rate_hz}
[[probe]]
name = "centre"
kind = "range"
pixels = [[959.5, 539.5]]
"""
