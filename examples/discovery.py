# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # What the model lacked
#
# `mammotwin discover STUDY.toml` asks which physical effect explains what the simulated poses leave of the measured
# ones. Here it looked at a digital volunteer whose breast tissue stiffens when it is stretched (Gent), analysed with a
# neo-Hookean model:
#
# ```
# mammotwin synth --preset tiny --seed 7 --hide limit_chain=0.8 --out runs/hidden
# mammotwin discover runs/hidden/study.toml
# ```
#
# The environment variable `MAMMOTWIN_DISCOVERY` may name another `discovery.h5`.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
import pandas

import mammotwin
from mammotwin import plots

plt.rcParams["figure.dpi"] = 64

found = mammotwin.open_discovery(os.environ.get("MAMMOTWIN_DISCOVERY", "../runs/hidden"))
print(found)

# %% [markdown]
# ## What was asked
#
# Each effect of the library has a signature, the change of the distances by its amplitude. The score says how much of
# it is in the data after the moduli took what they can. Effects that no plausible amplitude would show are not testable.

# %%
figure, axes = plt.subplots(figsize=(8, 4.4), layout="constrained")
plots.scores(found, axes)
plt.show()
print("not testable with these data:", ", ".join(found.not_testable))

# %% [markdown]
# ## What was fitted
#
# The likeliest effects, each together with both moduli; the held-out pose took no part.

# %%
pandas.DataFrame([vars(candidate) for candidate in found.candidates]).set_index("effect").round(3).T

# %% [markdown]
# ## The gap without and with the effect
#
# All maps on one scale, seen from the front. The floor is what the errors of images, registration, chest wall and mesh
# leave when the model lacks nothing.

# %%
gaps = list(found.gaps.values())
limit = max(np.abs(np.concatenate([gap.before_mm, gap.after_mm])).max() for gap in gaps)
figure, axes = plt.subplots(len(gaps), 2, figsize=(10, 3.1 * len(gaps)), layout="constrained", squeeze=False)
for row, gap in zip(axes, gaps):
    plots.gap_map(gap, "before", row[0], limit)
    plots.gap_map(gap, "after", row[1], limit)
plt.show()

# %%
rows = {gap.pose: (gap.rms_before_mm, gap.rms_after_mm, gap.floor_mm) for gap in gaps}
pandas.DataFrame(rows, index=["rms before (mm)", "after", "floor"]).T.round(2)
