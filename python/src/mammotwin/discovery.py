"""What `mammotwin discover` found (docs/discovery.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .errors import MissingError, NotResultsError
from .fields import Field
from .group import Group, OpenFile
from .mesh import Surface


@dataclass(frozen=True)
class Score:
    """One effect of the library, tested in the poses that the search saw."""

    effect: str
    #: Score (standard deviations), after the moduli took what they can.
    z: float
    #: Amplitude that explains most, linearly; None for an effect that the data could not show.
    amplitude: float | None
    #: Part of its signature that the moduli do not absorb.
    surviving: float
    #: Score that the largest plausible amplitude would have.
    detectable_z: float
    testable: bool


@dataclass(frozen=True)
class Candidate:
    """An effect that was fitted together with the moduli."""

    effect: str
    amplitude: float
    amplitude_sd: float
    #: Fall of the misfit of the seen poses (squared standard deviations).
    gain: float
    right_kpa: float
    left_kpa: float
    #: Root mean square distance (mm) of the held-out pose without and with the effect, and of the errors.
    held_out_before_mm: float
    held_out_after_mm: float
    held_out_floor_mm: float
    #: How much of the change that the effect foretells is in the held-out pose (standard errors; without it 0 ± 1).
    held_out_z: float
    #: By how many standard deviations the fit would go beyond the plausible range.
    beyond: float


@dataclass(frozen=True)
class Second:
    """What explains more than chance of what the best effect leaves."""

    effect: str
    #: Score (standard deviations) beside the first, and what chance exceeds once in a hundred times.
    z: float
    limit: float
    #: To first order in moduli and the first effect.
    amplitude: float


@dataclass(frozen=True)
class PoseModuli:
    """Young's moduli (kPa) that one pose alone asks for, and the deviations of their logarithms."""

    pose: str
    right_kpa: float
    left_kpa: float
    right_log_error: float
    left_log_error: float


@dataclass(frozen=True)
class Gap:
    """A pose without and with the effect that explains most; moduli fitted on both sides."""

    pose: str
    #: Simulated skins, with `signed_distance_mm` to the measured one; NaN where nothing is compared.
    before: Surface
    after: Surface
    #: Signed distances (mm) at the compared nodes.
    before_mm: np.ndarray
    after_mm: np.ndarray
    #: Root mean squares (mm) after the best rigid motion, and what errors alone leave.
    rms_before_mm: float
    rms_after_mm: float
    floor_mm: float


class Discovery(OpenFile):
    """The answer, and what it rests on. Lengths are mm, the frame is the reference pose's, RAS."""

    def _check(self) -> None:
        if "verdict" not in self._h5 or "gaps" not in self._h5:
            raise NotResultsError(f"{self.path}: no discovery.h5 of mammotwin")

    @cached_property
    def _verdict(self) -> dict[str, Any]:
        return self._root.json("verdict")

    @property
    def verdict(self) -> str:
        """`no_discrepancy`, `named`, `ambiguous`, `unknown`, `insufficient_data` or `measurement_artifact`."""
        return self._verdict["verdict"]

    @property
    def effect(self) -> str | None:
        """The effect or artefact that is named."""
        return self._verdict["effect"]

    @property
    def reason(self) -> str:
        """Why, in plain words."""
        return self._verdict["reason"]

    @property
    def alike(self) -> list[str]:
        """Effects that the data do not tell apart, the best first."""
        return self._verdict["set"]

    @property
    def not_testable(self) -> list[str]:
        """Effects that these data could not show."""
        return self._verdict["not_testable"]

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Effects that were fitted, the best first."""

        def one(found: dict[str, Any]) -> Candidate:
            held = found["held_out"]
            return Candidate(
                found["effect"],
                *found["amplitude"],
                found["gain"],
                *found["moduli_kpa"],
                held["before_mm"],
                held["after_mm"],
                held["floor_mm"],
                held["z"],
                found["beyond"],
            )

        return [one(found) for found in self._verdict["candidates"]]

    @property
    def second(self) -> Second | None:
        """A second effect beside the best one, where there is one."""
        found = self._verdict["second"]
        if found is None:
            return None
        return Second(found["effect"], found["z"], found["limit"], found["amplitude"])

    @cached_property
    def pose_moduli(self) -> list[PoseModuli]:
        """Moduli that each pose of the search asks for alone (linear)."""
        poses = self._root.json("drift")["poses"]
        return [PoseModuli(pose["pose"], *pose["moduli_kpa"], *pose["log_error"]) for pose in poses]

    @cached_property
    def limit(self) -> float:
        """Chance and systematic errors reach a score of this in 1 % of data without any effect."""
        return self._root.json("screening")["limit"]

    @cached_property
    def scores(self) -> list[Score]:
        """All effects, the largest score first."""
        scores = [Score(**score) for score in self._root.json("screening")["scores"]]
        return sorted(scores, key=lambda score: -score.z)

    @cached_property
    def cosines(self) -> tuple[list[str], np.ndarray]:
        """Names of the effects, and cosines between what survives of their signatures."""
        screening = self._root.json("screening")
        return [score["effect"] for score in screening["scores"]], np.array(screening["cosines"])

    @property
    def budget(self) -> dict[str, float]:
        """Sizes of the errors (mm)."""
        return self._root.json("budget")

    @cached_property
    def gaps(self) -> dict[str, Gap]:
        """Poses without and with the effect."""
        return {pose: self._gap(pose, self._root.group(f"gaps/{pose}")) for pose in self._root.texts("poses")}

    def _gap(self, pose: str, group: Group) -> Gap:
        active = group.array("active")

        def skin(when: str) -> Surface:
            kept = group.group(f"skin_{when}")
            points = kept.array("points")
            values = np.full(len(points), np.nan)
            values[active] = group.array(when)
            field = Field("signed_distance_mm", values, "mm", "signed distance to the measured skin", "scalar")
            return Surface(points, kept.array("triangles"), {field.name: field})

        before, after, floor = group.array("rms")
        return Gap(
            pose,
            skin("before"),
            skin("after"),
            group.array("before"),
            group.array("after"),
            float(before),
            float(after),
            float(floor),
        )

    def __repr__(self) -> str:
        named = f" {self.effect}" if self.effect else ""
        return f"<Discovery {self.verdict}{named}: {self.reason}>"


def open_discovery(path: str | Path) -> Discovery:
    """Opens `discovery.h5`, or the run folder that holds it, or the folder of the study.

    Raises FileNotFoundError, NotResultsError, or MissingError (a folder without it).
    """
    path = Path(path)
    if not path.is_dir():
        return Discovery(path)
    for place in (path / "discovery.h5", path / "out" / "discovery.h5"):
        if place.exists():
            return Discovery(place)
    raise MissingError(f"no discovery.h5 in {path} or {path / 'out'}", "discover", "run: mammotwin discover STUDY.toml")
