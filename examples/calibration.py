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
# # Calibration, and a pose that it never saw
#
# How the poses were brought together, which moduli were found, and how far the simulated skin is from the measured one
# before and after.
#
# The results are those of `scripts/demo`, or of the run that the environment variable `MAMMOTWIN_RESULTS` names. They
# are of a digital volunteer: the numbers show the method and say nothing about people.

# %%
import json
import os

import matplotlib.pyplot as plt
import numpy as np
import pandas

import mammotwin
from mammotwin import plots

plt.rcParams["figure.dpi"] = 64

results = mammotwin.open(os.environ.get("MAMMOTWIN_RESULTS", "../runs/demo"))
poses = [pose for pose in results.poses.values() if not pose.is_reference]
print(results)

# %% [markdown]
# ## Registration
#
# Everything lies in the frame of the reference pose (RAS mm). Each other pose was brought there by one rigid motion of
# its chest wall, which also says where gravity points.


# %%
def registration(pose):
    found = pose.registration
    return {
        "use": pose.use,
        "angle (deg)": found.to_reference.angle_deg,
        "similarity before": found.similarity_before,
        "after": found.similarity_after,
        "gravity": np.round(pose.after.gravity, 3),
    }


pandas.DataFrame({pose.name: registration(pose) for pose in poses}).T

# %% [markdown]
# ## Moduli
#
# Every evaluation finds the stress-free shape that belongs to its moduli, and loads it into the poses to be fitted.

# %%
calibration = results.calibration
figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
plots.calibration(calibration, axes[0])
calibration.trials["modified_hausdorff_mm"].plot(ax=axes[1], marker="o", color=plots.BLUE)
axes[1].set(ylim=(0, None), title="farthest of the fitted poses", xlabel="evaluation", ylabel="modified Hausdorff (mm)")
plt.show()

# %%
print("before:", calibration.before)
print("after: ", calibration.after)
print(f"reference pose from the stress-free shape: {calibration.round_trip_rms_mm:.1e} mm rms")

# %% [markdown]
# A digital volunteer has a truth, which no stage read:

# %%
truth = results.path.parent.parent / "truth" / "truth.json"
if truth.exists():
    moduli = json.loads(truth.read_text())["moduli"]
    for side in ("right", "left"):
        true, found = moduli[f"breast.young_{side}_kpa"], getattr(calibration.after, f"{side}_kpa")
        print(f"{side:5}: true {true:.3f} kPa, found {found:.3f} kPa ({100 * (found / true - 1):+.0f} %)")

# %% [markdown]
# ## Distances
#
# Between simulated and measured skin of the breasts (Mîra 2018, Appendix A). Poses of the use `validate` took no part
# in the fit: theirs is the error to be quoted.

# %%
rows = {}
for pose in poses:
    for when, fit in (("before", pose.before), ("after", pose.after)):
        found = fit.distances
        rows[pose.name, pose.use, when] = {
            "modified Hausdorff": found.modified_hausdorff_mm,
            "mean": found.mean_mm,
            "95 %": found.p95_mm,
            "largest": found.max_mm,
        }
table = pandas.DataFrame(rows).T
table.index.names = ["pose", "use", "fit"]
table.round(2)

# %% [markdown]
# The maps are seen from the front, her right on the left. Red lies outside of the measured skin, blue inside.

# %%
figure, axes = plt.subplots(len(poses), 2, figsize=(10, 2.9 * len(poses)), layout="constrained", squeeze=False)
for row, pose in zip(axes, poses):
    limit = np.abs(pose.before.signed_mm).max()
    plots.distance_map(pose.before, row[0], limit)
    plots.distance_map(pose.after, row[1], limit)
    row[0].set_title("before, " + row[0].get_title())
    row[1].set_title("after, " + row[1].get_title())
plt.show()

# %%
figure, axes = plt.subplots(1, len(poses), figsize=(5 * len(poses), 3), layout="constrained", squeeze=False)
for axis, pose in zip(axes[0], poses):
    limit = np.abs(pose.before.signed_mm).max()
    bins = np.linspace(-limit, limit, 31)
    axis.hist(pose.before.signed_mm, bins, color=plots.GREY, label="before")
    axis.hist(pose.after.signed_mm, bins, histtype="step", linewidth=2, color=plots.BLUE, label="after")
    axis.set(xlabel="signed distance (mm)", ylabel="nodes", title=f"{pose.name} ({pose.use})")
    axis.legend()
plt.show()
