# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Learn a sensor and simulate with it
#
# The embedded world has streets, a camera and a LiDAR of known physics, and needs no files. A small network learns what
# its LiDAR reports; then a depth map, labels and an image become a cloud.

# %%
import os

import numpy as np

import jaxsim
from jaxsim.cli import main

FLAGS = os.environ.get("TRAINING_FLAGS", "").split()

# %% [markdown]
# One measured sweep of the world, as a picture on the sensor's own grid, and as a cloud:

# %%
world = jaxsim.open_dataset("synthetic")
truth = world.truth(1920)
truth.image

# %%
frame = world[1920]
frame.cloud

# %% [markdown]
# Train a small network. `configs/demo.py` says how many steps that are, and how long they took. The same line again
# resumes.

# %%
main(["train", "demo", *FLAGS])

# %% [markdown]
# Simulate a street that training never saw, and turn it:

# %%
name = next((flag.split("=")[1] for flag in FLAGS if flag.startswith("--run.name=")), "demo")
sensor = jaxsim.load(f"runs/{name}")
view = frame.camera
cloud = sensor.simulate(rgb=view.rgb, depth_m=view.depth_m, semantic=view.semantic, instance=view.instance)
cloud

# %% [markdown]
# How far off is it? The mean intensity of what came back, simulated and measured:

# %%
valid = np.asarray(cloud.valid)
measured = np.asarray(frame.cloud.intensity)[np.asarray(frame.cloud.valid)]
print(f"simulated {np.asarray(cloud.intensity)[valid].mean():.3f}, measured {measured.mean():.3f}")
