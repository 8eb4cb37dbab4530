"""Mammograms, and the regions in which their quality was measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import xarray

from .errors import MissingError
from .group import Group
from .mesh import Surface
from .regions import Region, measure, read_regions, sites

if TYPE_CHECKING:
    from .results import Results


@dataclass(frozen=True)
class Technique:
    """What one picture took."""

    diameter_mm: float
    photons_per_mm2: float
    kerma_mgy: float


class Radiograph:
    """One mammogram: row 0 at the chest wall, columns along x of the detector's frame.

    That x runs from the nipple, roughly to the person's right; `Compression.to_detector` leads there.
    """

    def __init__(self, results: Results, name: str, group: Group) -> None:
        self._results = results
        self._group = group
        self.name = name
        #: What a pixel says.
        self.quantity = group.text("quantity")
        self.units = group.units("pixels")
        #: Distance of pixel centres.
        self.pitch_mm = group.number("pitch_mm")
        self._left_mm = group.number("left_mm")
        self._first_row_mm = group.number("first_row_mm")

    @cached_property
    def pixels(self) -> np.ndarray:
        """Detector signal (rows, columns)."""
        return self._group.array("pixels")

    @property
    def x_mm(self) -> np.ndarray:
        """Place of the columns' centres along the chest-wall edge, from the nipple."""
        return self._left_mm + self.pitch_mm * np.arange(self.pixels.shape[1])

    @property
    def y_mm(self) -> np.ndarray:
        """Distance of the rows' centres from the chest-wall edge."""
        return self._first_row_mm + self.pitch_mm * np.arange(self.pixels.shape[0])

    def to_xarray(self) -> xarray.DataArray:
        """The picture over `y_mm`, `x_mm`."""
        axis = {"units": "mm"}
        coordinates = {
            "y_mm": ("y_mm", self.y_mm, {**axis, "long_name": "Distance from the chest-wall edge"}),
            "x_mm": ("x_mm", self.x_mm, {**axis, "long_name": "Along the chest-wall edge, from the nipple"}),
        }
        attributes = {"units": self.units, "long_name": self.quantity}
        return xarray.DataArray(self.pixels, coordinates, ("y_mm", "x_mm"), self.name, attributes)

    @property
    def technique(self) -> Technique:
        """Exposure of this picture."""
        return Technique(*(self._group.number(name) for name in Technique.__dataclass_fields__))

    @cached_property
    def regions(self) -> list[Region]:
        """The squares around the microcalcifications, with signal, contrast and noise.

        Their means are the metrics `snr_*`, `sdnr_*` of the results.
        """
        if "regions" not in self._group:
            raise MissingError(f"no regions of interest of {self.name}", "quality")
        return read_regions(self._group.group("regions"))

    def measured_again(self) -> list[Region]:
        """The same by a second implementation: sites by the rule of the stage `phantom`, values from the pixels.

        Needs the run folder.
        """
        surface, plan, thickness_mm = self._results.phantom
        return measure(self, sites(surface, thickness_mm, plan["calcifications"]), self.technique.diameter_mm)

    def __repr__(self) -> str:
        rows, columns = self.pixels.shape
        return f"<Radiograph {self.name}: {rows} x {columns} pixels of {self.pitch_mm} mm, {self.quantity}>"


def read_phantom(results: Results) -> tuple[Surface, dict, float]:
    """Compressed surface in the detector's frame, plan of the picture, distance of the plates (mm)."""
    with results.folder.open("phantom") as file:
        surface = Surface(file.array("surface/points"), file.array("surface/triangles"))
        return surface, file.json("plan"), file.number("thickness")
