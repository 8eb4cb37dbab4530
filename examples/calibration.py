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
# ## How sure are they?
#
# The search makes the squared distances of the skin least, with the rigid motion of each pose left open. Its own answer to
# "how sure" is in results.h5 as `calibration/draws_kpa`, and in the report as 90 % intervals. Below is a simpler estimate: how
# a modulus changes when the mean distance of its breast along gravity is off by an assumed 0.3 mm.

# %%
error_mm = 0.3


def sureness(side):
    """Moduli that were tried, their residuals, and the interval that the error leaves."""
    young = calibration.trials[f"young_{side}_kpa"].values
    residual = calibration.trials[f"residual_{side}_mm"].values
    order = np.argsort(young)
    log, residual = np.log(young[order]), residual[order]
    log, first = np.unique(log, return_index=True)
    residual = residual[first]
    best = getattr(calibration.after, f"{side}_kpa")
    # The two trials on both sides of the modulus that was taken, or the nearest two.
    near = np.sort(np.argsort(np.abs(log - np.log(best)))[:2])
    slope = np.diff(residual[near])[0] / np.diff(log[near])[0]
    factor = np.exp(error_mm / abs(slope))
    return log, residual, (best / factor, best, best * factor)


found = {side: sureness(side) for side in ("right", "left")}
pandas.DataFrame({side: low_best_high for side, (_, _, low_best_high) in found.items()}, ["low", "found", "high"]).T.round(3)

# %% [markdown]
# The map shows the size of both distances over both moduli, between the trials; each breast's is taken to depend on its own
# modulus alone. Inside of the line both agree with the images up to the error.

# %%
figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
for (side, (log, residual, (low, best, high))), color in zip(found.items(), (plots.BLUE, plots.ORANGE)):
    axes[0].plot(np.exp(log), residual, "o-", color=color, label=side)
    axes[0].axvspan(low, high, color=color, alpha=0.15)
axes[0].axhspan(-error_mm, error_mm, color=plots.GREY, alpha=0.4)
axes[0].set(xlabel="Young's modulus (kPa)", ylabel="sags too far (mm)", title="distance by modulus")
axes[0].legend()

grids = [np.linspace(found[side][0].min(), found[side][0].max(), 80) for side in ("right", "left")]
sizes = [np.abs(np.interp(grid, *found[side][:2])) for side, grid in zip(("right", "left"), grids)]
worst = np.maximum(sizes[0][None, :], sizes[1][:, None])
painted = axes[1].pcolormesh(np.exp(grids[0]), np.exp(grids[1]), worst, cmap="cividis", shading="nearest")
figure.colorbar(painted, label="larger distance (mm)")
axes[1].contour(np.exp(grids[0]), np.exp(grids[1]), worst, [error_mm], colors="white")
trials = calibration.trials
axes[1].plot(trials["young_right_kpa"], trials["young_left_kpa"], ".-", color=plots.GREY, linewidth=0.8, label="trials")
axes[1].plot(calibration.after.right_kpa, calibration.after.left_kpa, "wo", markeredgecolor="black", label="taken")
if truth.exists():
    true = [moduli[f"breast.young_{side}_kpa"] for side in ("right", "left")]
    axes[1].plot(*true, "*", color="red", markersize=12, label="true")
axes[1].set(xlabel="right (kPa)", ylabel="left (kPa)", title="map of the calibration")
axes[1].legend(loc="lower right")
plt.show()

# %% [markdown]
# On a digital volunteer the truth may lie outside: an error that is the same all over a breast moves its modulus and is no
# noise. Compare the interval with the percentages above before you trust it.

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
