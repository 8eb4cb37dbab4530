"""The breast between the plates: its course, its pressure, what it bears."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import xarray

from .fields import Field, principal_stresses, weighted_percentile
from .mesh import Surface
from .states import State
from .transform import RigidTransform

if TYPE_CHECKING:
    from .results import Results


class Compression:
    """The compressed breast; stress-free shape and end of the compression are `state.rest` and `state.mesh`."""

    def __init__(self, results: Results, state: State, curve: xarray.Dataset) -> None:
        self._results = results
        #: The end of the compression, in the frame of the reference pose.
        self.state = state
        #: Forces, contact area and pressures over `thickness_mm`, the distance of the plates.
        self.curve = curve
        self._group = results.compression_group
        plan = results.parameters["compress"]
        #: `right`, `left`
        self.side: str = self._group.text("side")
        #: `cc`, ...
        self.view: str = plan["view"]
        #: `rigid`, ...
        self.paddle: str = plan["paddle"]
        #: Distance of the plates' edges from the chest wall, mm.
        self.chest_wall_distance_mm: float = plan["chest_wall_distance_mm"]

    @property
    def thickness_mm(self) -> float:
        """Distance of the plates at the end."""
        return float(self.curve["thickness_mm"][-1])

    @property
    def force_n(self) -> float:
        """Force of the paddle at the end."""
        return float(self.curve["force_n"][-1])

    @property
    def contact_pressure(self) -> Field:
        """Contact pressure (kPa, positive) at the nodes of `state.mesh`."""
        return self.state.mesh.point_fields["contact_pressure_kpa"]

    @property
    def pressure_map(self) -> Surface:
        """The compressed skin with the field `contact_pressure_kpa`, in the frame of the reference pose."""
        skin = self.state.mesh.surface("skin")
        field = skin.point_fields["contact_pressure_kpa"]
        return Surface(skin.points, skin.triangles, {field.name: field}, skin.nodes)

    @cached_property
    def to_detector(self) -> RigidTransform:
        """From the reference pose to the frame of the detector.

        There x runs along the chest-wall edge of the plates from the nipple, y from that edge away from the chest
        wall, z from the receptor to the paddle (mm).
        """
        return RigidTransform.from_group(self._group.group("to_detector"))

    @cached_property
    def stopped_early(self) -> str | None:
        """Why it ended before its stop rule; `None` when the rule was met."""
        return self._group.text("stopped_early") or None

    @property
    def nipple_node(self) -> int:
        """Node of `state.mesh` that is the nipple."""
        return int(self._group.number("nipple_node"))

    @property
    def nipple_mm(self) -> np.ndarray:
        """Place of the nipple in the frame of the detector."""
        return self._group.array("nipple_mm")

    @cached_property
    def steps(self) -> xarray.Dataset:
        """All load steps over `thickness_mm`, in the frame of the reference pose, in single precision.

        `points` of the nodes (mm), `contact_pressure_kpa` at the nodes, `von_mises_kpa` in the tetrahedra; `plates_mm`
        are the heights of the plates at their chest-wall edge, z of the detector at the end.
        """
        group = self._group.group("steps")
        over = {
            "points": ("thickness_mm", "node", "xyz"),
            "contact_pressure_kpa": ("thickness_mm", "node"),
            "von_mises_kpa": ("thickness_mm", "tet"),
            "plates_mm": ("thickness_mm", "plate"),
        }
        fields = {name: (group.field(name), dimensions) for name, dimensions in over.items()}
        variables = {
            name: (dimensions, field.values, {"units": field.units, "long_name": field.long_name})
            for name, (field, dimensions) in fields.items()
        }
        return xarray.Dataset(variables, {"thickness_mm": self.curve["thickness_mm"], "xyz": ["x", "y", "z"], "plate": ["receptor", "paddle"]})

    def pressure_percentile_kpa(self, percent: float) -> float:
        """Contact pressure that `percent` of the plates' touched faces, by area, does not exceed; without fronts."""
        fields = self.state.mesh.point_fields
        values, areas = (fields[name].values for name in ("contact_pressure_kpa", "contact_area_mm2"))
        touched = (values > 0) & (areas > 0)
        return weighted_percentile(values[touched], areas[touched], percent) if touched.any() else 0.0

    def von_mises_percentile_kpa(self, percent: float) -> float:
        """Von Mises stress that `percent` of the compressed volume does not exceed."""
        mesh = self.state.mesh
        return weighted_percentile(mesh.cell_fields["von_mises_kpa"].values, mesh.volumes_mm3, percent)

    def principal_stress_percentile_kpa(self, percent: float, which: str = "largest") -> float:
        """Principal stress (`largest` or `smallest`, positive in tension) that `percent` of the volume does not exceed."""
        mesh = self.state.mesh
        column = {"largest": 0, "smallest": 2}[which]
        values = principal_stresses(mesh.cell_fields["cauchy_kpa"].values)[:, column]
        return weighted_percentile(values, mesh.volumes_mm3, percent)

    @property
    def peak_pressure_place_mm(self) -> np.ndarray:
        """Node with the largest contact pressure, in the frame of the detector: y from the plates' chest-wall edge."""
        mesh = self.state.mesh
        node = int(np.argmax(mesh.point_fields["contact_pressure_kpa"].values))
        return self.to_detector(mesh.points[node][None])[0]

    def strain_percentile(self, percent: float, which: str = "largest") -> float:
        """Principal logarithmic strain (`largest` or `smallest`, positive in extension) that `percent` of the volume does not exceed."""
        mesh = self.state.mesh
        column = {"largest": 0, "smallest": 2}[which]
        strains = np.log(mesh.cell_fields["principal_stretches"].values[:, column])
        return weighted_percentile(strains, mesh.volumes_mm3, percent)

    def __repr__(self) -> str:
        return f"<Compression {self.side} {self.view}: {self.thickness_mm:.1f} mm, {self.force_n:.3g} N>"
