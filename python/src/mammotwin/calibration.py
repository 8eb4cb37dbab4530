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
class Shared:
    """A number that both breasts share, as it was fitted: kPa, or 1 for a Jₘ."""

    value: float
    #: Standard deviation of its logarithm; NaN where the poses tell nothing of it.
    sd_ln: float
    #: Drawn together with the moduli of the breasts; empty where the poses tell nothing of it.
    draws: np.ndarray


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
    #: What was fitted beside the moduli of the breasts, by its key in the study, such as `skin.young_kpa`.
    shared: dict[str, Shared]

    @property
    def best_trial(self) -> int:
        """Number of the evaluation whose numbers were taken: that with the least misfit."""
        return int(self.trials["misfit_mm"].values.argmin())
