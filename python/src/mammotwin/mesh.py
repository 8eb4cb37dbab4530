"""Tetrahedra and surfaces with fields, and their way to pyvista and meshio."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from .errors import need
from .fields import Field
from .transform import RAS_TO_LPS, RigidTransform

Frame = Literal["RAS", "LPS"]


class Tissue(IntEnum):
    """Labels of voxels and tetrahedra. Right and left are the person's; her right is +x."""

    BACKGROUND = 0
    ADIPOSE_RIGHT = 1
    ADIPOSE_LEFT = 2
    FIBROGLANDULAR_RIGHT = 3
    FIBROGLANDULAR_LEFT = 4
    SKIN = 5
    PECTORAL_MUSCLE = 6
    THORAX = 7
    NIPPLE_AREOLA = 8
    OTHER = 9


def _arrays(fields: dict[str, Field], frame: Frame) -> dict[str, np.ndarray]:
    """Plain arrays; tensors row by row with nine components."""
    turned = fields.values() if frame == "RAS" else (f.rotated(RAS_TO_LPS) for f in fields.values())
    return {f.name: f.values.reshape(len(f), 9) if f.kind == "tensor" else f.values for f in turned}


def _placed(points: np.ndarray, frame: Frame) -> np.ndarray:
    if frame not in ("RAS", "LPS"):
        raise ValueError(f"frame is {frame!r}; give 'RAS' or 'LPS'")
    return points if frame == "RAS" else points @ RAS_TO_LPS


@dataclass(frozen=True)
class Surface:
    """Triangles, mm, RAS; outward.

    `nodes` are the indices of the points in the mesh it was taken from, where there is one.
    """

    points: np.ndarray
    triangles: np.ndarray
    point_fields: dict[str, Field] = field(default_factory=dict)
    nodes: np.ndarray | None = None

    def moved(self, motion: RigidTransform) -> Surface:
        """The surface in another frame."""
        fields = {name: f.rotated(motion.rotation) for name, f in self.point_fields.items()}
        return replace(self, points=motion(self.points), point_fields=fields)

    @cached_property
    def areas_mm2(self) -> np.ndarray:
        """Area of each triangle."""
        a, b, c = (self.points[self.triangles[:, n]] for n in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    def node_areas_mm2(self) -> np.ndarray:
        """A third of the area of the triangles around each point."""
        areas = np.zeros(len(self.points))
        np.add.at(areas, self.triangles.ravel(), np.repeat(self.areas_mm2 / 3.0, 3))
        return areas

    def to_pyvista(self, frame: Frame = "RAS"):
        """A `pyvista.PolyData`. 3D Slicer takes meshes for LPS unless told otherwise: give `frame="LPS"` for it."""
        pyvista = need("pyvista", "mesh")
        # From RAS to LPS is a half turn about z: faces stay outward, volumes positive.
        surface = pyvista.PolyData.from_regular_faces(_placed(self.points, frame), self.triangles.astype(np.int64))
        for name, values in _arrays(self.point_fields, frame).items():
            surface.point_data[name] = values
        surface.field_data["coordinate_system"] = [f"{frame} mm"]
        return surface

    def to_meshio(self, frame: Frame = "RAS"):
        """A `meshio.Mesh` of triangles."""
        meshio = need("meshio", "mesh")
        cells = [("triangle", self.triangles.astype(np.int64))]
        return meshio.Mesh(_placed(self.points, frame), cells, point_data=_arrays(self.point_fields, frame))

    def __repr__(self) -> str:
        names = ", ".join(self.point_fields)
        return f"<Surface {len(self.points)} points, {len(self.triangles)} triangles: {names}>"


@dataclass(frozen=True)
class Mesh:
    """Tetrahedra, mm, RAS.

    `points` (n, 3), `tets` (m, 4), `tissues` (m,) as labels of [`Tissue`], `patches`: outer faces (k, 3) by name.
    """

    points: np.ndarray
    tets: np.ndarray
    tissues: np.ndarray
    patches: dict[str, np.ndarray]
    point_fields: dict[str, Field] = field(default_factory=dict)
    cell_fields: dict[str, Field] = field(default_factory=dict)

    @cached_property
    def volumes_mm3(self) -> np.ndarray:
        """Volume of each tetrahedron; positive."""
        edges = self.points[self.tets[:, 1:]] - self.points[self.tets[:, :1]]
        return np.linalg.det(edges) / 6.0

    @cached_property
    def centers(self) -> np.ndarray:
        """Centre of each tetrahedron, mm."""
        return self.points[self.tets].mean(axis=1)

    def moved(self, motion: RigidTransform) -> Mesh:
        """The mesh in another frame; vectors and tensors turn with it."""
        turned = lambda fields: {name: f.rotated(motion.rotation) for name, f in fields.items()}  # noqa: E731
        return replace(
            self,
            points=motion(self.points),
            point_fields=turned(self.point_fields),
            cell_fields=turned(self.cell_fields),
        )

    def surface(self, patch: str | None = None) -> Surface:
        """A patch (`skin`, `chest_wall`, ...) or, without a name, all outer faces together."""
        if patch is not None and patch not in self.patches:
            raise KeyError(f"no patch {patch!r}; there are {', '.join(self.patches)}")
        faces = self.patches[patch] if patch else np.concatenate(list(self.patches.values()))
        nodes, triangles = np.unique(faces, return_inverse=True)
        fields = {name: f.taken(nodes) for name, f in self.point_fields.items()}
        return Surface(self.points[nodes], triangles.reshape(-1, 3), fields, nodes)

    def to_pyvista(self, frame: Frame = "RAS"):
        """A `pyvista.UnstructuredGrid` with all fields; tensors have nine components, row by row.

        3D Slicer takes meshes for LPS unless told otherwise: give `frame="LPS"` for it.
        """
        pyvista = need("pyvista", "mesh")
        points = _placed(self.points, frame)
        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: self.tets.astype(np.int64)}, points)
        grid.cell_data["tissue"] = self.tissues
        for name, values in _arrays(self.point_fields, frame).items():
            grid.point_data[name] = values
        for name, values in _arrays(self.cell_fields, frame).items():
            grid.cell_data[name] = values
        grid.field_data["coordinate_system"] = [f"{frame} mm"]
        return grid

    def to_meshio(self, frame: Frame = "RAS"):
        """A `meshio.Mesh` with all fields; tensors have nine components, row by row."""
        meshio = need("meshio", "mesh")
        fields = {"tissue": self.tissues, **_arrays(self.cell_fields, frame)}
        return meshio.Mesh(
            _placed(self.points, frame),
            [("tetra", self.tets.astype(np.int64))],
            point_data=_arrays(self.point_fields, frame),
            cell_data={name: [values] for name, values in fields.items()},
        )

    def save(self, path: str | Path, frame: Frame = "RAS") -> None:
        """Writes the mesh and its fields in any format of meshio, `.vtu` for example."""
        self.to_meshio(frame).write(str(path))

    def __repr__(self) -> str:
        names = ", ".join([*self.point_fields, *self.cell_fields])
        return f"<Mesh {len(self.points)} nodes, {len(self.tets)} tetrahedra: {names}>"
