# %% [markdown]
# # Widths of a flight
#
# From a drone's log and video to a river's widths, with the truth beside them: the flight is simulated, over a river whose
# banks are known. Your log and video take its place.

# %%
import json
import subprocess
import sys

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import aerodft as ad

command = "-m aerodft.sim --out flight --duration 12 --fps 2 --size 960x540 --std height=0.3,tilt=0.3"
simulated = json.loads(subprocess.check_output([sys.executable, *command.split()]))
print(f"{simulated['images']} images, and a log that is off by {simulated['bias']['height_m']:+.2f} m of height")

# %% [markdown]
# ## What is the log good for?
#
# `diagnose` is `aerodft doctor`: what can be measured, and what is missing, stale or set wrongly.

# %%
diagnosis = ad.diagnose("flight/flight.tlog")
print("usable:", diagnosis.usable)
for problem in diagnosis.problems[:3]:
    print("-", problem)

# %% [markdown]
# ## A station, and a recording with measurements
#
# `draft_station` writes `station.toml` and `camera.toml` (of a known camera by its name), and says what they are taken from.
# How high the take-off point lies above the water only you can measure; here it lies at the water's level.

# %%
sources = ["flight/flight.tlog", "flight/video.mp4"]
draft = ad.draft_station(sources, "mine", camera="flight/camera.toml", home_above_plane_m=0.0)
for sentence in (*draft.taken, *draft.to_do):
    print("-", sentence)

# %% [markdown]
# The video's start is known here to the nanosecond; of your own video `align` finds it from how the camera turned.

# %%
result = ad.import_flight(
    "flight/flight.tlog",
    station=draft.station,
    video="flight/video.mp4",
    video_start_ns=int(simulated["start_ns"]),
    output="recording",
)
print(result.statistics.images, "images, poses:", dict(result.statistics.poses))

# %% [markdown]
# ## The river's widths
#
# The banks are found in the images, put together on the map, and measured across transects.

# %%
survey = ad.survey_river("recording", spacing_m=3, images=3)
files = survey.save("reach")
width = survey.width_m
print(f"{width['median']:.2f} m in the median, {width['ci95'][0]:.2f} to {width['ci95'][1]:.2f} m with 95 %")

# %%
Image.open("reach/plate.png")

# %% [markdown]
# ## Beside the truth
#
# What the simulator knows of three places along the river, and what was measured there.

# %%
found = [each for each in survey.document["transects"] if each["width_m"] is not None]
found.sort(key=lambda each: each["points_enu_m"][0][0])
east_m = np.array([np.mean(each["points_enu_m"], axis=0)[0] for each in found])
low_m, high_m = np.array([each["ci95"] for each in found]).T
with open("flight/truth.jsonl") as lines:
    truth = {item["name"]: item for item in map(json.loads, lines) if item["name"] in ("width-a", "width-b", "width-c")}

figure = Figure(figsize=(8, 3.5), layout="constrained")
axes = figure.subplots()
axes.fill_between(east_m, low_m, high_m, alpha=0.25, label="95 % interval")
axes.plot(east_m, [each["width_m"] for each in found], ".", label="measured")
for name, item in sorted(truth.items()):
    at_m = np.mean(item["enu_m"], axis=0)[0]
    low, high = (np.interp(at_m, east_m, ends) for ends in (low_m, high_m))
    print(f"{name}: {item['value']:.2f} m, measured as {low:.2f} to {high:.2f} m: {low <= item['value'] <= high}")
    axes.plot(at_m, item["value"], "kx", label="truth" if name == "width-a" else None)
axes.set(xlabel="east (m)", ylabel="width (m)")
axes.legend()
figure

# %% [markdown]
# ## For a map, and for somebody's desk
#
# `river.gpkg` opens in QGIS with its style, `river.html` in any browser.

# %%
summary = ad.export("reach", "river.gpkg")
page = ad.report("reach", "river.html")
print(summary.file, summary.counts, page)
