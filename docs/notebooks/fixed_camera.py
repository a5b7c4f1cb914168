# %% [markdown]
# # A fixed camera from landmarks
#
# A camera over a river, a photo of it, and what somebody knows of its view: where the camera hangs and where it looks follows
# from that, how surely too, and then distances and heights in its images do.

# %%
from matplotlib.figure import Figure
from PIL import Image

import aerodft as ad

Image.open("configs/calibration/bridge.jpg").reduce(2)

# %% [markdown]
# ## What is known
#
# A gauge, two bolts and a jetty that were surveyed, a rangefinder's distances, a length on the ground, a person's height,
# kerbs that run parallel: the file says each with its pixels and standard deviations.

# %%
with open("configs/calibration/bridge-landmarks.toml") as file:
    lines = file.read().splitlines()
begin = lines.index("[[landmark]]")
print("\n".join(lines[begin : begin + 13]))

# %% [markdown]
# ## Where the camera hangs
#
# The scene is made up, so that the truth is known: 7.93 m above the water at (3.2, -1.5), tilt 62.3, roll -0.6, heading
# 127.4 degrees.

# %%
camera = ad.load_camera("configs/cameras/demo-1080p.toml")
unknowns = ["position", "height", "tilt", "roll", "heading", "focal"]
result = ad.calibrate("configs/calibration/bridge-landmarks.toml", camera, unknowns)
for name, value in result.values.items():
    print(f"{name:14} {value:9.3f}  std {result.stds[name]:.3f}")
for note in result.notes:
    print("-", note)

# %% [markdown]
# Residuals, and metres on the ground that follow from what was found: where the grid lies on the water, the pose is right.

# %%
result.save("bridge.toml")
page = result.write_report("bridge")
Image.open("bridge/annotated.jpg").reduce(2)

# %% [markdown]
# ## Measuring with it
#
# All that the calibration does not know for sure, lens included, is in the interval.

# %%
probes = [
    ad.Distance([(717.6, 793.5), (1331.2, 763.4)], name="across"),
    ad.Height([(1138.7, 394.5), (1147.0, 262.9)], name="person"),
]
for each in ad.measure(camera, None, probes, calibration="bridge.toml"):
    print(each)

# %% [markdown]
# ## What the landmarks are worth
#
# The distance to what each row of the image shows, with the calibration, and with a height and a tilt that somebody read off
# the mount: to 0.1 m and 1 degree. Where a distance is known to worse than 30 % there is no number.

# %%
rows = range(1000, 100, -20)
ranges = [ad.Range([(960, row)], name=f"row {row}") for row in rows]
stated = ad.CameraPose(height_m=7.93, tilt_deg=62.3, std=ad.PoseStd(height_m=0.1, tilt_deg=1.0))
figure = Figure(figsize=(8, 3.5), layout="constrained")
axes = figure.subplots()
for label, found in {
    "height and tilt read off the mount": ad.measure(camera, stated, ranges),
    "calibrated by landmarks": ad.measure(camera, None, ranges, calibration="bridge.toml"),
}.items():
    answered = [each for each in found if each.value is not None]
    print(
        f"{label}: {len(answered)} of {len(rows)} rows have a number, the farthest is {answered[-1].value:.0f} m away"
    )
    axes.plot([each.value for each in answered], [100 * each.std / each.value for each in answered], ".-", label=label)
axes.set(xlabel="distance from the camera (m)", ylabel="std (% of the distance)", yscale="log")
axes.legend()
figure
