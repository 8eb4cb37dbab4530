"""Quantities over nodes or cells, with their units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

Kind = Literal["scalar", "vector", "tensor", "invariants"]


@dataclass(frozen=True)
class Field:
    """A quantity at each node or in each cell.

    `kind` says what a rotation of the frame does to it: vectors and tensors turn; scalars and invariants (principal
    stretches) stay.
    """

    name: str
    values: np.ndarray
    units: str
    long_name: str
    kind: Kind = "scalar"

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.asarray(self.values, dtype=dtype)

    def __len__(self) -> int:
        return len(self.values)

    def rotated(self, rotation: np.ndarray) -> Field:
        """The same field in a frame that is turned by `rotation` (3, 3)."""
        if self.kind == "vector":
            return replace(self, values=self.values @ rotation.T)
        if self.kind == "tensor":
            return replace(self, values=rotation @ self.values @ rotation.T)
        return self

    def taken(self, rows: np.ndarray) -> Field:
        """The field at some of the nodes or cells."""
        return replace(self, values=self.values[rows])

    def __repr__(self) -> str:
        return f"<Field {self.name} {self.values.shape} {self.units}: {self.long_name}>"


def von_mises(cauchy: np.ndarray) -> np.ndarray:
    """Von Mises stress √(3/2 s:s), s the deviator of the Cauchy stress (n, 3, 3); same unit."""
    mean = np.trace(cauchy, axis1=1, axis2=2) / 3.0
    deviator = cauchy - mean[:, None, None] * np.eye(3)
    return np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))


def principal_stresses(cauchy: np.ndarray) -> np.ndarray:
    """Eigenvalues of the Cauchy stress (n, 3, 3), largest first, positive in tension; same unit."""
    return np.linalg.eigvalsh(cauchy)[:, ::-1]


def principal_stretches(gradient: np.ndarray) -> np.ndarray:
    """Singular values of the deformation gradient (n, 3, 3), largest first."""
    return np.linalg.svd(gradient, compute_uv=False)


def weighted_percentile(values: np.ndarray, weights: np.ndarray, percent: float) -> float:
    """The value that `percent` of all weight does not exceed."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    first = np.searchsorted(share, percent / 100.0 * share[-1])
    return float(values[order][min(first, len(values) - 1)])
