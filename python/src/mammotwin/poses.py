"""Poses: how each lies to the reference pose, and how far its simulation is from what was measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .errors import MissingError, need
from .fields import Field
from .group import Group
from .mesh import Mesh, Surface
from .states import State
from .transform import RigidTransform

if TYPE_CHECKING:
    from .results import Results


@dataclass(frozen=True)
class Registration:
    """The rigid motion of a pose's image to the reference pose, and what it says of itself."""

    to_reference: RigidTransform
    #: The motion that the landmarks alone gave; a search over the images where there were fewer than three.
    from_landmarks: RigidTransform
    landmarks: int
    landmark_rms_mm: float | None
    #: Mean local correlation over the chest wall, before and after.
    similarity_before: float
    similarity_after: float
    #: How far the chest wall changed its shape beyond the rigid motion, rms; `None` when it was taken for rigid.
    change_rms_mm: float | None
    #: Standard deviations about the axes x, y, z.
    sd_rotation_deg: np.ndarray
    sd_translation_mm: np.ndarray
    #: Front of the muscle after the motion: signed distance from the chest wall of the reference, mean, 95 % and largest
    #: magnitude, and the part within 5 mm (Mîra 2018, fig. 3.4); `None` where the labels show no breast.
    wall_mean_mm: float | None = None
    wall_p95_mm: float | None = None
    wall_max_mm: float | None = None
    wall_within_5mm: float | None = None


@dataclass(frozen=True)
class Distances:
    """Distances between simulated and measured skin, mm (Mîra 2018, eqs. A.3-A.7)."""

    min_mm: float
    max_mm: float
    mean_mm: float
    p95_mm: float
    hausdorff_mm: float
    modified_hausdorff_mm: float


@dataclass(frozen=True)
class PoseFit:
    """A simulated pose beside the measured one.

    `nodes` are the compared nodes of the mesh; `signed_mm` is the distance of each to the measured skin, positive
    outside of it.
    """

    pose: str
    nodes: np.ndarray
    signed_mm: np.ndarray
    distances: Distances
    gravity: np.ndarray
    skin: Surface

    @property
    def distance_map(self) -> Surface:
        """The simulated skin with the field `signed_distance_mm`, NaN where nothing is compared."""
        values = np.full(self.skin.nodes.max() + 1, np.nan)
        values[self.nodes] = self.signed_mm
        long_name = "Signed distance to the measured skin, positive outside of it"
        mapped = Field("signed_distance_mm", values[self.skin.nodes], "mm", long_name)
        return Surface(self.skin.points, self.skin.triangles, {mapped.name: mapped}, self.skin.nodes)


def read_fit(pose: str, group: Group, gravity: np.ndarray, rest: Mesh, points: np.ndarray) -> PoseFit:
    """Reads how far a simulated pose is from the measured one; `points` are its nodes, `rest` has the same mesh."""
    skin = rest.surface("skin")
    return PoseFit(
        pose,
        group.array("nodes"),
        group.array("signed_distance_mm"),
        Distances(**{name: group.number(name) for name in Distances.__dataclass_fields__}),
        gravity,
        Surface(points[skin.nodes], skin.triangles, {}, skin.nodes),
    )


class Pose:
    """One pose of the study."""

    def __init__(self, results: Results, name: str, plan: dict) -> None:
        self._results = results
        self.name = name
        #: `fit`, `validate`
        self.use: str = plan["use"]
        #: `supine`, `prone`, ...; `None` when the study gives the direction of gravity itself.
        self.posture: str | None = plan.get("posture")
        #: What the study warns of.
        self.warning: str | None = plan.get("warning")

    @property
    def is_reference(self) -> bool:
        """Whether all others lie in the frame of this one."""
        return self.name == self._results.reference_pose

    @property
    def state(self) -> State:
        """The simulated equilibrium, in the frame of the reference pose."""
        return self._results.pose_state(self.name)

    @property
    def _group(self) -> Group:
        return self._results.pose_group(self.name)

    @cached_property
    def gravity(self) -> np.ndarray:
        """Direction of gravity in the frame of the reference pose, a unit vector."""
        return self._group.array("gravity")

    @cached_property
    def registration(self) -> Registration:
        """How the pose was registered; the reference pose has none."""
        if self.is_reference:
            raise MissingError(f"{self.name} is the reference pose, others are registered to it", "register")
        found = self._group.group("registration")
        optional = lambda name: found.number(name) if name in found else None  # noqa: E731
        return Registration(
            RigidTransform.from_group(self._group.group("to_reference")),
            RigidTransform.from_group(found.group("from_landmarks")),
            int(found.number("landmarks")),
            optional("landmark_rms_mm"),
            found.number("similarity_before"),
            found.number("similarity_after"),
            optional("change_rms_mm"),
            found.array("sd_rotation_deg"),
            found.array("sd_translation_mm"),
            *(optional(f"wall_{name}") for name in ("mean_mm", "p95_mm", "max_mm", "within_5mm")),
        )

    @property
    def to_reference(self) -> RigidTransform:
        """From the pose's image to the frame of the reference pose (RAS mm)."""
        return RigidTransform.identity() if self.is_reference else self.registration.to_reference

    @cached_property
    def measured_skin(self) -> Surface:
        """Measured skin, in the frame of the pose's own image (mm); large."""
        with self._results.folder.open("surface", self.name) as file:
            return Surface(file.array("skin/points"), file.array("skin/triangles"))

    @property
    def labels_file(self) -> Path:
        """The segmentation, a NIfTI file in the frame of the pose's own image."""
        path = self._results.folder.path / "labels" / f"{self.name}.nii.gz"
        if not path.exists():
            hint = "it lies beside results.h5, or is a file of the study's own"
            raise MissingError(f"no {path}", f"segment:{self.name}", hint)
        return path

    def labels(self):
        """The segmentation as a nibabel image: `affine` from voxels to RAS mm."""
        return need("nibabel", "image").load(self.labels_file)

    @cached_property
    def before(self) -> PoseFit:
        """With the moduli of the study."""
        return self._fit("before")

    @cached_property
    def after(self) -> PoseFit:
        """With the fitted moduli."""
        return self._fit("after")

    def _fit(self, when: str) -> PoseFit:
        if self.is_reference:
            text = f"{self.name} is the reference pose: its shape is given, nothing is compared"
            raise MissingError(text, "calibrate", "see results.calibration.round_trip_rms_mm")
        rest = self.state.rest
        points = self._group.array("solution/points" if when == "after" else "before/points")
        return read_fit(self.name, self._group.group(when), self.gravity, rest, points)

    def __repr__(self) -> str:
        word = "reference" if self.is_reference else self.use
        return f"<Pose {self.name}: {word}>"
