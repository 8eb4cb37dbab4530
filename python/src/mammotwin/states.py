"""States of equilibrium: a mesh, where it is now, and what it bears there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .fields import Field, principal_stretches, von_mises
from .group import Group
from .mesh import Mesh


@dataclass(frozen=True)
class Checks:
    """How well an equilibrium was reached; plain numbers, lengths in mm."""

    iterations: int
    steps: int
    residual: float
    min_det_f: float
    max_penetration_mm: float
    max_gap_mm: float
    force_imbalance: float
    moment_imbalance: float
    friction_lag: float
    #: NaN in results of before it was measured.
    internal_imbalance: float = math.nan


def read_mesh(group: Group) -> Mesh:
    """Reads `points`, `tets`, `tissues`, `patches`."""
    faces = group.group("patches")
    patches = {name: faces.array(name) for name in faces.names()}
    return Mesh(group.array("points"), group.array("tets"), group.array("tissues"), patches)


class State:
    """A pose or the compressed breast, in the frame of the reference pose (RAS mm)."""

    def __init__(self, name: str, group: Group, rest: Group) -> None:
        self.name = name
        self.long_name = str(group.h5.attrs.get("long_name", name))
        self._group = group
        self._rest = rest

    @cached_property
    def rest(self) -> Mesh:
        """The stress-free shape, without fields."""
        return read_mesh(self._rest)

    @cached_property
    def mesh(self) -> Mesh:
        """The shape in equilibrium, with all fields.

        At nodes: `displacement_mm` (from the stress-free shape), `mean_stress_kpa` (tr σ / 3: negative in
        compression), `contact_pressure_kpa` (positive) and `contact_area_mm2` when compressed. In tetrahedra:
        `von_mises_kpa`, `volume_ratio`,
        `principal_stretches`, `deformation_gradient`, `cauchy_kpa`.
        """
        rest, solution = self.rest, self._group.group("solution")
        points = solution.array("points")
        gradient = solution.field("deformation_gradient", "tensor")
        cauchy = solution.field("cauchy_kpa", "tensor")
        moved = Field(
            "displacement_mm", points - rest.points, "mm", "Displacement from the stress-free shape", "vector"
        )
        nodal = [moved, solution.field("mean_stress_kpa")]
        contact = ("contact_pressure_kpa", "contact_area_mm2")
        nodal += [self._group.field(field) for field in contact if field in self._group]
        stretches = principal_stretches(gradient.values)
        cells = [
            Field("von_mises_kpa", von_mises(cauchy.values), "kPa", "Von Mises stress"),
            Field("volume_ratio", np.linalg.det(gradient.values), "1", "Volume over stress-free volume, det F"),
            Field("principal_stretches", stretches, "1", "Principal stretches, largest first", "invariants"),
            gradient,
            cauchy,
        ]
        by_name = lambda fields: {f.name: f for f in fields}  # noqa: E731
        return Mesh(points, rest.tets, rest.tissues, rest.patches, by_name(nodal), by_name(cells))

    @cached_property
    def forces_n(self) -> dict[str, np.ndarray]:
        """Total force (N) of each term of the model on the body, RAS."""
        forces = self._group.group("solution/forces")
        return dict(zip(forces.texts("names"), forces.array("force_n"), strict=True))

    @cached_property
    def checks(self) -> Checks:
        """How well the equilibrium was reached."""
        checks = self._group.group("solution/checks")
        known = set(checks.names())
        number = {name: checks.number(name) for name in Checks.__dataclass_fields__ if name in known}
        number["iterations"], number["steps"] = int(number["iterations"]), int(number["steps"])
        return Checks(**number)

    def __repr__(self) -> str:
        return f"<State {self.name}: {self.long_name}>"
