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
# # Force curves and comfort
#
# What the plates did to the breast: their forces on the way, the pressure on the skin, stress and strain inside.
#
# The results are those of `scripts/demo`, or of the run that the environment variable `MAMMOTWIN_RESULTS` names. They
# are of a digital volunteer: the numbers show the method and say nothing about people.

# %%
import os

import matplotlib.pyplot as plt

import mammotwin
from mammotwin import plots

plt.rcParams["figure.dpi"] = 64

results = mammotwin.open(os.environ.get("MAMMOTWIN_RESULTS", "../runs/demo"))
compression = results.compression
compression

# %% [markdown]
# ## The course
#
# An `xarray.Dataset` over the distance of the plates; every variable knows its unit.

# %%
curve = compression.curve
curve.to_dataframe().tail(4).round(3)

# %%
figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
plots.force_curve(compression, axes[0])
plots.pressure_curve(compression, axes[1])
plt.show()

# %% [markdown]
# The plates do not carry the same force: the breast is held at the chest wall, which takes the difference. In the frame
# of the detector (z from the receptor to the paddle) all forces on the body sum to nothing:

# %%
forces = {name: compression.to_detector.direction(force) for name, force in compression.state.forces_n.items()}
for name, (x, y, z) in forces.items():
    if max(abs(x), abs(y), abs(z)) > 1e-6:
        print(f"{name:10} {x:8.3f} {y:8.3f} {z:8.3f} N")
print(f"{'sum':10}" + "".join(f" {value:8.3f}" for value in sum(forces.values()) + 0.0) + " N")

# %% [markdown]
# ## Pressure on the skin
#
# Grey skin is not touched. The edges of the plates are at 0: what is coloured there lies on their upright fronts, which
# press the breast towards the chest wall (the forces along y above).

# %%
figure, axes = plt.subplots(1, 2, figsize=(10, 3.0), layout="constrained")
plots.pressure_map(compression, "paddle", axes[0])
plots.pressure_map(compression, "receptor", axes[1])
plt.show()

# %% [markdown]
# Contact area and mean pressure of the curve are those of the paddle's face, as seen along the compression; what lies on
# its front is told apart:

# %%
comfort = results.comfort
print(f"contact area of the paddle's face {comfort['contact_area_cm2'].value:.1f} cm2, of its front ", end="")
print(f"{comfort['front_area_cm2'].value:.1f} cm2, which pushes with {comfort['front_force_n'].value:.2f} N")
print(f"mean pressure of the face {comfort['mean_pressure_kpa'].value:.3f} kPa")

# %% [markdown]
# ## Comfort metrics
#
# Percentiles by area (pressure) and by volume (stress, strain), since maxima depend on the mesh.

# %%
results.comfort.to_pandas()[["value", "units", "long_name"]].round(3)

# %% [markdown]
# They follow from the fields, so that any other percentile can be had, too:

# %%
print("percent  von Mises (kPa)  strain")
for percent in (50, 75, 90, 95, 99):
    stress, strain = compression.von_mises_percentile_kpa(percent), compression.strain_percentile(percent)
    print(f"{percent:7}  {stress:15.4f}  {strain:6.3f}")

# %% [markdown]
# ## The picture
#
# The squares are those in which signal and noise were measured, one around each microcalcification.

# %%
picture = list(results.radiographs.values())[-1]
figure, axes = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
plots.mammogram(picture, compression.side, axes[0])
for name, marker in (("snr", "o"), ("snr_detrended", "s")):
    axes[1].plot([getattr(region, name) for region in picture.regions], marker, label=name)
axes[1].set(xlabel="region", ylabel="signal over noise", ylim=(0, None), title="by region")
axes[1].legend()
plt.show()

# %%
results.dose.to_pandas()[["value", "units", "thesis", "long_name"]].round(3)
