# %% [markdown]
# # The paper, executed
#
# The method is that of Salih, Simsim and Malik, "Distance and Size Measurements of Objects in the Scene from a Single 2D Image".
# Its own equations are approximate. `aerodft paper` computes its Tables 1 to 3 and Figures 12 and 14 from its inputs, prints them
# beside its own figures, and gives a sentence for every difference.

# %%
import subprocess
import sys

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import aerodft as ad

done = subprocess.run(
    [sys.executable, "-m", "aerodft", "paper", "-o", "paper"], capture_output=True, text=True, check=True
)
print(done.stdout)

# %%
Image.open("paper/figure-12.png")

# %%
Image.open("paper/figure-14.png")

# %% [markdown]
# ## How far the paper's model is from the pinhole's
#
# aerodft has both: `pinhole` (the default) and `dft`, the paper to the letter. The difference has two parts: angles that the
# paper takes linear in pixels, and Eq. 5, `X = Y tan phi`, which is far off for a camera that looks steeply down: straight
# down it gives no width at all. Here a width, level in the middle of the image, 10.48 m below the camera's height:

# %%
camera = ad.load_camera("configs/cameras/canon-1000d.toml")
width = ad.Distance([(1000, 1296), (2900, 1296)])
tilts_deg = np.arange(0, 76)
values_m = {"pinhole": [], "dft": []}
for tilt_deg in tilts_deg:
    pose = ad.CameraPose(height_m=10.48, tilt_deg=float(tilt_deg))
    for model, values in values_m.items():
        values.append(ad.measure(camera, pose, width, model=model).value)

print("tilt   pinhole      paper  difference")
for tilt_deg in (0, 30, 67):
    pinhole_m, paper_m = (values_m[model][tilt_deg] for model in ("pinhole", "dft"))
    print(f"{tilt_deg:3} deg {pinhole_m:7.2f} m {paper_m:8.2f} m {100 * (paper_m / pinhole_m - 1):8.0f} %")

# %%
figure = Figure(figsize=(8, 3.5), layout="constrained")
axes = figure.subplots()
share = np.array(values_m["dft"]) / np.array(values_m["pinhole"])
axes.plot(tilts_deg, 100 * share, label="the paper's width, of the pinhole's")
axes.plot(tilts_deg, 100 * np.sin(np.radians(tilts_deg)), "--", label="sin(tilt): what Eq. 5 leaves of X")
axes.set(xlabel="tilt (deg from straight down)", ylabel="share (%)", ylim=(0, 105))
axes.legend()
figure

# %% [markdown]
# `aerodft explain --compare` says of any pixels how much of the difference Eq. 5 makes, and how much the angles.
