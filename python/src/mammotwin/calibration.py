"""Moduli and stress-free shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray

from .mesh import Mesh


@dataclass(frozen=True)
class Moduli:
    """Young's moduli of the breasts, kPa."""

    right_kpa: float
    left_kpa: float


@dataclass(frozen=True)
class Calibration:
    """What the search for the moduli found; without poses to fit, `before` and `after` are the same."""

    #: Moduli of the study.
    before: Moduli
    #: Fitted moduli.
    after: Moduli
    #: Study keys that were fitted.
    fitted: list[str]
    #: Every evaluation: moduli, residuals, modified Hausdorff distance over `trial`.
    trials: xarray.Dataset
    #: Stress-free shape that belongs to the fitted moduli.
    rest: Mesh
    #: Nodes of it that are the nipples, right and left.
    nipple_nodes: np.ndarray
    #: Reference pose, loaded again from it: distance of the nodes.
    round_trip_rms_mm: float
    round_trip_max_mm: float
    #: Way of sliding nodes onto the chest wall before unloading: the farthest.
    off_wall_max_mm: float

    @property
    def best_trial(self) -> int:
        """Number of the evaluation whose moduli were taken."""
        tried = np.stack([self.trials["young_right_kpa"].values, self.trials["young_left_kpa"].values])
        taken = np.array([[self.after.right_kpa], [self.after.left_kpa]])
        return int(np.abs(tried - taken).sum(axis=0).argmin())
