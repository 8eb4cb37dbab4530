"""Rigid motions between the frames of a study, RAS mm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import need
from .group import Group

#: From RAS to LPS, and back: x and y change their signs.
RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class RigidTransform:
    """`p -> rotation @ p + translation_mm`, points in RAS mm."""

    rotation: np.ndarray
    translation_mm: np.ndarray

    @classmethod
    def identity(cls) -> RigidTransform:
        """The motion that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_group(cls, group: Group) -> RigidTransform:
        """Reads a motion of `results.h5`: `rotation` row by row, `translation_mm`."""
        return cls(group.array("rotation"), group.array("translation_mm"))

    @classmethod
    def from_json(cls, value: dict) -> RigidTransform:
        """Reads the JSON of a stage or of the truth, whose `rotation` lists the rows of the matrix."""
        return cls(np.array(value["rotation"], dtype=float), np.array(value["translation"], dtype=float))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Moves points of shape (3,) or (n, 3), mm."""
        return np.asarray(points, dtype=float) @ self.rotation.T + self.translation_mm

    def direction(self, vectors: np.ndarray) -> np.ndarray:
        """Turns directions of shape (3,) or (n, 3)."""
        return np.asarray(vectors, dtype=float) @ self.rotation.T

    @property
    def inverse(self) -> RigidTransform:
        """The motion back."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation_mm)

    def then(self, following: RigidTransform) -> RigidTransform:
        """This motion first, then `following`."""
        rotation = following.rotation @ self.rotation
        return RigidTransform(rotation, following(self.translation_mm))

    @property
    def matrix(self) -> np.ndarray:
        """Homogeneous (4, 4), RAS mm, for columns: nibabel's, 3D Slicer's (in its own module) way."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_mm
        return matrix

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation."""
        r = self.rotation
        axis = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
        return float(np.degrees(np.arctan2(0.5 * np.linalg.norm(axis), 0.5 * (np.trace(r) - 1.0))))

    def lps(self) -> RigidTransform:
        """The same motion for points in LPS mm, as ITK and DICOM have them."""
        flip = RAS_TO_LPS
        return RigidTransform(flip @ self.rotation @ flip, flip @ self.translation_mm)

    def to_simpleitk(self):
        """A `SimpleITK.Euler3DTransform` that moves physical points (LPS mm) as this motion does.

        `SimpleITK.Resample(moving, fixed, T)` wants the way from the fixed to the moving image: for a pose onto the
        reference pose it is `pose.to_reference.inverse.to_simpleitk()`.
        """
        sitk = need("SimpleITK", "image")
        moved = self.lps()
        transform = sitk.Euler3DTransform()
        transform.SetMatrix(moved.rotation.ravel().tolist(), 1e-8)
        transform.SetTranslation(moved.translation_mm.tolist())
        return transform

    def save(self, path: str | Path) -> None:
        """Writes an ITK transform (`.tfm`, LPS) that brings a pose's image onto the reference pose in 3D Slicer and
        ITK-SNAP.

        The file holds the inverse of this motion, since ITK resamples: from fixed to moving.
        """
        need("SimpleITK", "image").WriteTransform(self.inverse.to_simpleitk(), str(path))
