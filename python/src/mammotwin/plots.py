"""Pictures of results with matplotlib. Every function draws into `ax`, or makes one, and returns it."""

from __future__ import annotations

import numpy as np

from .calibration import Calibration
from .compression import Compression
from .discovery import Discovery, Gap
from .errors import need
from .mesh import Surface
from .poses import PoseFit
from .radiograph import Radiograph
from .regions import REGION_MM

#: Colours that colour-blind people tell apart (Okabe & Ito 2008).
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#999999"


def _axes(ax):
    return ax if ax is not None else need("matplotlib.pyplot", "plot").subplots()[1]


def force_curve(compression: Compression, ax=None):
    """Forces of paddle and receptor over the distance of the plates, which falls to the right."""
    ax = _axes(ax)
    curve = compression.curve
    thickness = curve["thickness_mm"]
    ax.plot(thickness, curve["force_n"], color=BLUE, marker="o", label="paddle")
    ax.plot(thickness, curve["receptor_force_n"], color=ORANGE, marker="s", label="receptor")
    ax.set(xlabel="distance of the plates (mm)", ylabel="force (N)")
    ax.set_title(f"{compression.side} breast, {compression.view.upper()}, {compression.paddle} paddle")
    ax.invert_xaxis()
    ax.legend()
    return ax


def pressure_curve(compression: Compression, ax=None):
    """Mean contact pressure under the paddle, and the largest under either plate."""
    ax = _axes(ax)
    curve = compression.curve
    ax.plot(curve["thickness_mm"], curve["mean_pressure_kpa"], color=BLUE, marker="o", label="mean, paddle")
    ax.plot(curve["thickness_mm"], curve["peak_pressure_kpa"], color=ORANGE, marker="s", label="largest")
    ax.set(xlabel="distance of the plates (mm)", ylabel="contact pressure (kPa)")
    ax.invert_xaxis()
    ax.legend()
    return ax


def pressure_map(compression: Compression, seen_from: str = "paddle", ax=None):
    """Contact pressure on the skin, seen from the `paddle` or from the `receptor`; grey is not touched."""
    ax = _axes(ax)
    if seen_from not in ("paddle", "receptor"):
        raise ValueError(f"seen_from is {seen_from!r}; give 'paddle' or 'receptor'")
    skin = compression.pressure_map.moved(compression.to_detector)
    toward = np.array([0.0, 0.0, 1.0 if seen_from == "paddle" else -1.0])
    values = skin.point_fields["contact_pressure_kpa"].values
    limits = (0.0, max(float(values.max()), 1e-12))
    faces = values[skin.triangles].mean(axis=1)
    _draw(ax, skin, np.where(faces > 0, faces, np.nan), toward, (0, 1), "cividis", limits, "contact pressure (kPa)")
    ax.set(xlabel="along the chest wall (mm)", ylabel="from the plates' edge (mm)")
    ax.set_title(f"seen from the {seen_from}")
    if seen_from == "receptor":
        ax.invert_xaxis()
    return ax


def distance_map(fit: PoseFit, ax=None, limit_mm: float | None = None):
    """Signed distance of the simulated skin to the measured one, seen from the front: her right is on the left.

    Red is outside of the measured skin, blue inside, grey not compared.
    """
    ax = _axes(ax)
    skin = fit.distance_map
    limit = limit_mm or float(np.abs(fit.signed_mm).max())
    values = skin.point_fields["signed_distance_mm"].values[skin.triangles].mean(axis=1)
    toward = np.array([0.0, 1.0, 0.0])
    _draw(ax, skin, values, toward, (0, 2), "RdBu_r", (-limit, limit), "signed distance (mm)")
    ax.set(xlabel="x, to her right (mm)", ylabel="z, to the head (mm)")
    ax.set_title(f"{fit.pose}: modified Hausdorff {fit.distances.modified_hausdorff_mm:.2f} mm", fontsize="medium")
    ax.invert_xaxis()
    return ax


def gap_map(gap: Gap, when: str, ax=None, limit_mm: float | None = None):
    """Signed distance of a simulated skin to the measured one `before` or `after` an effect was added, from the front."""
    ax = _axes(ax)
    if when not in ("before", "after"):
        raise ValueError(f"when is {when!r}; give 'before' or 'after'")
    skin = gap.before if when == "before" else gap.after
    rms = gap.rms_before_mm if when == "before" else gap.rms_after_mm
    limit = limit_mm or float(np.abs(np.concatenate([gap.before_mm, gap.after_mm])).max())
    values = skin.point_fields["signed_distance_mm"].values[skin.triangles].mean(axis=1)
    _draw(ax, skin, values, np.array([0.0, 1.0, 0.0]), (0, 2), "RdBu_r", (-limit, limit), "signed distance (mm)")
    ax.set(xlabel="x, to her right (mm)", ylabel="z, to the head (mm)")
    ax.set_title(f"{gap.pose}, {when}: {rms:.2f} mm rms (floor {gap.floor_mm:.2f})", fontsize="medium")
    ax.invert_xaxis()
    return ax


def scores(found: Discovery, ax=None):
    """Scores of all effects, and the line that chance and systematic errors pass in 1 % of data without any."""
    ax = _axes(ax)
    ranked = found.scores[::-1]
    colours = [BLUE if score.z > found.limit else GREY for score in ranked]
    ax.barh([score.effect for score in ranked], [score.z for score in ranked], color=colours)
    ax.axvline(found.limit, color=ORANGE, label=f"limit {found.limit:.1f}")
    ax.set(xlabel="score (standard deviations)", title=found.verdict.replace("_", " "))
    ax.legend(loc="lower right")
    return ax


def _draw(ax, surface: Surface, faces, toward, shown, colours: str, limits, label: str) -> None:
    """Values of the faces that look `toward` the eye, the nearest last; NaN is grey."""
    corners = surface.points[surface.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    seen = np.flatnonzero(normals @ toward > 0)
    seen = seen[np.argsort(corners[seen].mean(axis=1) @ toward)]
    collections = need("matplotlib.collections", "plot")
    colour_map = need("matplotlib", "plot").colormaps[colours].with_extremes(bad="#d9d9d9")
    drawn = collections.PolyCollection(corners[seen][:, :, list(shown)], cmap=colour_map, linewidths=0.1)
    drawn.set_array(np.ma.masked_invalid(faces[seen]))
    drawn.set_edgecolor("face")
    drawn.set_clim(*limits)
    ax.add_collection(drawn)
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.figure.colorbar(drawn, ax=ax, label=label, shrink=0.8)


def calibration(found: Calibration, ax=None):
    """Moduli of every evaluation of the search; the taken one is ringed."""
    ax = _axes(ax)
    trials = found.trials
    for side, colour, marker in (("right", BLUE, "o"), ("left", ORANGE, "s")):
        moduli = trials[f"young_{side}_kpa"]
        ax.plot(trials["trial"], moduli, color=colour, marker=marker, label=f"{side} breast")
        best = found.best_trial
        ax.plot([best], [float(moduli[best])], "o", markersize=14, fillstyle="none", color=colour)
    ax.set(xlabel="evaluation", ylabel="Young's modulus (kPa)", title="search for the moduli")
    ax.legend()
    return ax


def mammogram(picture: Radiograph, side: str, ax=None, regions: bool = True, coarser: int = 4):
    """The picture as it is hung: lateral is up, the chest wall is right for the right breast and left for the left.

    The view ends a little beyond the breast. `regions` draws the squares in which quality was measured; `coarser`
    pixels a side become one.
    """
    ax = _axes(ax)
    if side not in ("right", "left"):
        raise ValueError(f"side is {side!r}; give 'right' or 'left'")
    pixels = picture.pixels
    rows, columns = (n // coarser * coarser for n in pixels.shape)
    signal = pixels[:rows, :columns].reshape(rows // coarser, coarser, -1, coarser).mean(axis=(1, 3))
    tissue = np.log(pixels.max() / np.maximum(signal, 1e-4 * pixels.max()))
    high = float(np.quantile(tissue, 0.9995))
    inside = tissue[tissue > 0.5 * high]
    span = max(high - float(np.quantile(inside, 0.02)), 0.15 * high)
    half = 0.5 * picture.pitch_mm
    x, y = picture.x_mm, picture.y_mm
    extent = (y[0] - half, y[rows - 1] + half, x[0] - half, x[columns - 1] + half)
    window = {"vmin": high - 1.5 * span, "vmax": high}
    ax.imshow(tissue.T, origin="lower", extent=extent, cmap="gray", interpolation="nearest", **window)
    if regions:
        patches = need("matplotlib.patches", "plot")
        for region in picture.regions:
            x_mm, y_mm = region.center_mm
            corner = (y_mm - REGION_MM / 2, x_mm - REGION_MM / 2)
            ax.add_patch(patches.Rectangle(corner, REGION_MM, REGION_MM, fill=False, color=ORANGE))
    breast = np.argwhere(tissue > 0.2 * high) * coarser * picture.pitch_mm
    margin = 10.0
    ax.set_xlim(y[0] - half, min(y[0] + breast[:, 0].max() + margin, extent[1]))
    ax.set_ylim(x[0] + breast[:, 1].min() - margin, x[0] + breast[:, 1].max() + margin)
    # Her right is +x.
    ax.invert_xaxis() if side == "right" else ax.invert_yaxis()
    ax.set(xlabel="from the chest wall (mm)", ylabel="along the chest wall (mm)")
    ax.set_title(f"{picture.name}, {side}")
    return ax
