"""Regions of interest around microcalcifications (Mîra 2018, eqs. 5.1-5.5).

`read_regions` reads them; `sites` and `measure` are a second implementation of what the stages `phantom` and `quality`
do, against which the program is tested.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .group import Group
from .mesh import Surface

if TYPE_CHECKING:
    from .radiograph import Radiograph

#: Height of the focal spot above the centre of the detector's chest-wall edge, mm.
SOURCE_HEIGHT_MM = 660.0
#: Side of a region, mm.
REGION_MM = 10.0
#: Places of the matrix are tried at this distance, mm.
_STEP_MM = 1.0
#: The breast touches both plates where it is as thick as they are apart, within this share.
_CONTACT = 0.15
#: A calcification needs this share of the thickness.
_TISSUE = 0.5


@dataclass(frozen=True)
class Site:
    """A microcalcification: its place in the matrix, its centre in the detector's frame (mm)."""

    row: int
    column: int
    center_mm: np.ndarray


@dataclass(frozen=True)
class Region:
    """A square of 10 mm around the shadow of a microcalcification.

    `center_mm` is (x, y) on the detector. The `_detrended` values have the plane of the background taken away.
    """

    site: Site
    center_mm: tuple[float, float]
    calcification: float
    background: float
    snr: float
    sdnr: float
    snr_detrended: float
    sdnr_detrended: float


def read_regions(group: Group) -> list[Region]:
    """Reads `/radiographs/NAME/regions`."""
    columns = ["calcification", "background", "snr", "sdnr", "snr_detrended", "sdnr_detrended"]
    values = zip(*(group.array(name).tolist() for name in columns), strict=True)
    places = zip(group.array("row").tolist(), group.array("column").tolist(), group.array("site_mm"), strict=True)
    centers = [(x, y) for x, y in group.array("center_mm").tolist()]
    return [
        Region(Site(*place), center, *row) for place, center, row in zip(places, centers, values, strict=True)
    ]


def thickness_map(surface: Surface, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Length (mm) of the vertical line at each place (y, x) inside of a closed surface."""
    depth = np.zeros((len(y_mm), len(x_mm)))
    step_x, step_y = x_mm[1] - x_mm[0], y_mm[1] - y_mm[0]
    for a, b, c in surface.points[surface.triangles]:
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        i = slice(max(0, int(np.ceil((low[0] - x_mm[0]) / step_x))), int(np.floor((high[0] - x_mm[0]) / step_x)) + 1)
        j = slice(max(0, int(np.ceil((low[1] - y_mm[0]) / step_y))), int(np.floor((high[1] - y_mm[0]) / step_y)) + 1)
        if i.start >= i.stop or j.start >= j.stop:
            continue
        x, y = np.meshgrid(x_mm[i], y_mm[j])
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice == 0.0:
            continue
        # Barycentric coordinates; the upper face (counter-clockwise from above) leaves, the lower one enters.
        u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice
        v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        # What hangs below the receptor's plane is not between focal spot and detector.
        z = np.maximum(a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]), 0.0)
        depth[j, i] += np.where(inside, np.sign(twice) * z, 0.0)
    return depth


def _clearance(touches: np.ndarray) -> np.ndarray:
    """Steps to the next place without contact, the larger of both directions; 0 there and beyond the border."""
    left = np.pad(touches, 1).astype(bool)
    result = np.zeros(left.shape, dtype=int)
    while left.any():
        result += left
        shrunk = left.copy()
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                shrunk &= np.roll(left, (dy, dx), axis=(0, 1))
        left = shrunk
    return result[1:-1, 1:-1]


def sites(surface: Surface, thickness_mm: float, plan: dict) -> list[Site]:
    """Where the matrix of microcalcifications lies; `surface` is in the detector's frame.

    Most of it lies between the plates, and there as far as possible from where the breast leaves them.
    """
    used = surface.points[np.unique(surface.triangles)]
    low, high = used.min(axis=0), used.max(axis=0)
    columns = int(np.ceil((high[0] - low[0]) / _STEP_MM)) + 3
    rows = int(np.ceil(max(high[1], 0.0) / _STEP_MM)) + 3
    x_mm = low[0] - _STEP_MM + _STEP_MM * np.arange(columns)
    y_mm = -0.5 * _STEP_MM + _STEP_MM * np.arange(rows)
    depth = thickness_map(surface, x_mm, y_mm)
    touches = np.abs(depth / thickness_mm - 1.0) <= _CONTACT
    touches[0] = False
    clearance = _clearance(touches)

    pitch = plan["pitch_mm"]
    numbered = [(row, column) for row in range(plan["rows"]) for column in range(plan["columns"])]
    centered = np.array(numbered, dtype=float) - 0.5 * (np.array([plan["rows"], plan["columns"]]) - 1.0)
    offsets = centered * pitch

    def at(values: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Values at the nearest places, 0 outside."""
        column = np.floor((x - x_mm[0]) / _STEP_MM + 0.5).astype(int)
        row = np.floor((y - y_mm[0]) / _STEP_MM + 0.5).astype(int)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(inside, values[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)], 0)

    best, placed = (0, 0, 0), None
    for y in y_mm:
        for x in x_mm:
            clear = at(clearance, y + offsets[:, 0], x + offsets[:, 1])
            clear = clear[clear > 0]
            merit = (len(clear), int(clear.min()) if len(clear) else 0, int(clear.sum()))
            if merit > best:
                best, placed = merit, np.array([y, x]) + offsets
    if placed is None:
        return []
    kept = at(depth, placed[:, 0], placed[:, 1]) >= _TISSUE * thickness_mm
    return [
        Site(row, column, np.array([x, y, 0.5 * thickness_mm]))
        for (row, column), (y, x), keep in zip(numbered, placed, kept, strict=True)
        if keep
    ]


def measure(picture: Radiograph, places: list[Site], diameter_mm: float) -> list[Region]:
    """Signal, contrast and noise around the shadows of microcalcifications."""
    return [_region(picture, site, 0.5 * diameter_mm) for site in places]


def _region(picture: Radiograph, site: Site, radius_mm: float) -> Region:
    magnification = SOURCE_HEIGHT_MM / (SOURCE_HEIGHT_MM - site.center_mm[2])
    center = site.center_mm[:2] * magnification
    x, y = picture.x_mm - center[0], picture.y_mm - center[1]
    columns, rows = np.abs(x) <= 0.5 * REGION_MM, np.abs(y) <= 0.5 * REGION_MM
    values = picture.pixels[np.ix_(rows, columns)].astype(float)
    x, y = np.meshgrid(x[columns], y[rows])
    # Pixels may be wider than the calcification: the one that holds the centre counts in any case.
    half = 0.500001 * picture.pitch_mm
    calcified = (np.hypot(x, y) <= radius_mm) | ((np.abs(x) <= half) & (np.abs(y) <= half))
    around = ~calcified
    calcification, background = values[calcified].mean(), values[around].mean()
    sigma = values[around].std()
    basis = np.stack([np.ones_like(x), x, y], axis=-1)
    plane, *_ = np.linalg.lstsq(basis[around], values[around], rcond=None)
    residual = values - basis @ plane
    flat = np.sqrt(np.mean(residual[around] ** 2))
    return Region(
        site,
        (float(center[0]), float(center[1])),
        float(calcification),
        float(background),
        float(background / sigma),
        float((background - calcification) / sigma),
        float(background / flat),
        float(-residual[calcified].mean() / flat),
    )
