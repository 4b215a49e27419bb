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
# # Discover a hidden effect
#
# Streets as a sensor saw them, and as a simulator shows them that lacks one effect. Which one? The generator of the
# streets shares no code with jaxsim; run this in a checkout, where it is.

# %%
import json
import os
from pathlib import Path

from benchmarks.blind.hidden.__main__ import main as hidden
from jaxsim.discover import disagreements, discover_folders, read_comparison

CASE = Path("case")
SEED = int(os.environ.get("SEED", "217"))

# %% [markdown]
# Make the case. Its key, which says what is hidden, lies beside the folder; nothing below reads it before the end.

# %%
if not CASE.exists():
    hidden(["make", str(CASE), "--seed", str(SEED), "--effect", "beam_gain", "--severity", "2"])
comparison = read_comparison(simulated=CASE / "simulated", measured=CASE / "measured")
rows, columns = comparison.scan.range_m.shape[1:]
print(f"{len(comparison.names)} frames of {len(set(comparison.scenes))} drives, {rows} rows x {columns} columns")

# %% [markdown]
# Where do the two disagree? The first step alone: residuals by what they depend on, strongest first.

# %%
for place in disagreements(comparison):
    print(f"{place.channel} along {place.covariate}: p {place.p_value:.2g}, {100 * place.share:.0f} % of the variance")

# %% [markdown]
# Which effect is it, and how much of the gap does it close on streets that nothing was fitted to? The report below
# turns: drag the cloud, move the slider, click on a beam.

# %%
result = discover_folders(simulated=CASE / "simulated", measured=CASE / "measured")
result

# %% [markdown]
# The answer for programs, and the sensor model that `jaxsim simulate --effects` applies:

# %%
print([effect.name for effect in result.verdict.effects], result.verdict.verdict)
result.effects_model.save(CASE / "sensor.json")

# %% [markdown]
# Now open the key.

# %%
print([effect["name"] for effect in json.loads(Path("case.key.json").read_text())["effects"]])
