"""The results of one study."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import xarray

from .calibration import Calibration, Moduli, Shared
from .compression import Compression
from .errors import MissingError, NotResultsError, SchemaError
from .folder import RunFolder, StageRecord
from .group import Group, OpenFile
from .mesh import Mesh, Surface
from .metrics import Metrics, read_metrics
from .poses import Pose
from .radiograph import Radiograph, Technique, read_phantom
from .states import State, read_mesh

#: Version of the layout (docs/hdf5.md) that this package reads.
SCHEMA_VERSION = 2
COORDINATE_SYSTEM = "RAS mm"


def open(path: str | Path) -> Results:  # noqa: A001 - the name is the package's: mammotwin.open
    """Opens `results.h5`, the run folder that holds it, or the folder of the study.

    Raises FileNotFoundError, NotResultsError (another kind of file), SchemaError (another version of the layout), or
    MissingError (a folder without results).
    """
    return Results(_locate(Path(path)))


def _locate(path: Path) -> Path:
    if not path.is_dir():
        if path.suffix == ".toml":
            raise NotResultsError(f"{path}: a study; give its run folder, `out` beside it unless --out said otherwise")
        return path
    for place in (path / "results.h5", path / "out" / "results.h5"):
        if place.exists():
            return place
    raise MissingError(f"no results.h5 in {path} or {path / 'out'}", "results", "run: mammotwin run STUDY.toml")


class Results(OpenFile):
    """What a study found out. Lengths are mm, the frame is the reference pose's, RAS.

    Arrays are read when they are asked for. Use as a context manager, or `close()` it.
    """

    def _check(self) -> None:
        attributes = self._h5.attrs
        version = attributes.get("schema_version")
        if version is None:
            raise NotResultsError(
                f"{self.path}: no results.h5 of mammotwin (no attribute schema_version); results of single stages are "
                "reached by opening the run folder"
            )
        if int(version) != SCHEMA_VERSION:
            newer = int(version) > SCHEMA_VERSION
            remedy = "update this package" if newer else "run the study again"
            raise SchemaError(f"{self.path}: layout {version}, this package reads {SCHEMA_VERSION}; {remedy}")
        system = attributes.get("coordinate_system")
        if system != COORDINATE_SYSTEM:
            raise SchemaError(f"{self.path}: coordinate system {system!r}, not {COORDINATE_SYSTEM!r}")

    # What was asked for, and what made it

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """The study, without the paths of its files."""
        return self._root.json("parameters")

    @property
    def subject(self) -> str:
        """Name of the subject in the study."""
        return self.parameters["subject"]["id"]

    @property
    def reference_pose(self) -> str:
        """Pose whose frame all is in: the study's, or else supine, or else the first by name."""
        named = self.parameters["model"].get("reference_pose")
        poses = self.parameters["poses"]
        if named:
            return named
        return "supine" if "supine" in poses else min(poses)

    @cached_property
    def provenance(self) -> list[StageRecord]:
        """The stages that made these results, in the order of their work."""
        group = self._root.group("provenance")
        columns = (group.texts(name) for name in ("stage", "of", "key", "content"))
        return [StageRecord(*row) for row in zip(*columns, strict=True)]

    @cached_property
    def program_version(self) -> str:
        """Version of mammotwin that wrote the file."""
        return self._root.text("provenance/program_version")

    @cached_property
    def folder(self) -> RunFolder:
        """The results of single stages, beside `results.h5`."""
        return RunFolder(self.path, self.provenance)

    # Poses and mechanics

    @cached_property
    def poses(self) -> dict[str, Pose]:
        """The poses of the study, the reference pose first."""
        plans = self.parameters["poses"]
        order = sorted(plans, key=lambda name: (name != self.reference_pose, name))
        return {name: Pose(self, name, plans[name]) for name in order}

    @cached_property
    def states(self) -> dict[str, State]:
        """Every state of equilibrium by name: the poses, and `compressed`.

        A pose that is itself called `compressed` is reached by `poses["compressed"].state`.
        """
        poses = self._root.group("poses").names() if "poses" in self._root else []
        states = {name: self.pose_state(name) for name in poses}
        if "compression" in self._root:
            group = self.compression_group
            states["compressed"] = State("compressed", group, group.group("rest"))
        return states

    def pose_group(self, name: str) -> Group:
        """`/poses/NAME` of the file."""
        return self._root.group(f"poses/{name}")

    @property
    def compression_group(self) -> Group:
        """`/compression` of the file."""
        return self._root.group("compression")

    def pose_state(self, name: str) -> State:
        """The simulated equilibrium of a pose."""
        return State(name, self.pose_group(name), self._root.group("calibration/rest"))

    @cached_property
    def mesh(self) -> Mesh:
        """The tetrahedra of the reference pose, before any mechanics."""
        with self.folder.open("mesh") as file:
            return read_mesh(file.group("mesh"))

    @cached_property
    def calibration(self) -> Calibration:
        """Moduli and stress-free shape."""
        group = self._root.group("calibration")
        moduli = {
            when: Moduli(group.number(f"{when}/young_right_kpa"), group.number(f"{when}/young_left_kpa"))
            for when in ("before", "after")
        }
        shared = {}
        for key in group.texts("fitted"):
            name = f"shared/{key.replace('.', '_')}"
            if name in group:
                known = f"{name}/sd_ln" in group
                shared[key] = Shared(
                    group.number(f"{name}/value"),
                    group.number(f"{name}/sd_ln") if known else float("nan"),
                    group.array(f"{name}/draws") if known else np.empty(0),
                )
        return Calibration(
            moduli["before"],
            moduli["after"],
            group.texts("fitted"),
            self.curve("calibration"),
            read_mesh(group.group("rest")),
            group.array("nipple_nodes"),
            group.number("after/round_trip_rms_mm"),
            group.number("after/round_trip_max_mm"),
            group.number("after/off_wall_max_mm"),
            shared,
        )

    @cached_property
    def compression(self) -> Compression:
        """The breast between the plates."""
        if "compression" not in self._root:
            text = "no compression in these results"
            raise MissingError(text, "compress", "ask for one: [compress] in the study, then mammotwin run")
        return Compression(self, self.states["compressed"], self.curve("force_thickness"))

    # Curves, pictures, numbers

    @property
    def curves(self) -> list[str]:
        """Names of the curves."""
        return self._root.group("curves").names() if "curves" in self._root else []

    def curve(self, name: str) -> xarray.Dataset:
        """A curve: variables over one axis, each with `units` and `long_name`."""
        if name not in self.curves:
            stage = {"force_thickness": "compress", "calibration": "calibrate"}.get(name, "results")
            raise MissingError(f"no curve {name!r}; there are {', '.join(self.curves) or 'none'}", stage)
        group = self._root.group(f"curves/{name}")
        axis = next(key for key in group.names() if group.h5[key].is_scale)
        column = lambda key: (axis, group.array(key), _attributes(group.h5[key]))  # noqa: E731
        variables = {key: column(key) for key in group.names() if key != axis}
        long_name = str(group.h5.attrs.get("long_name", name))
        return xarray.Dataset(variables, {axis: column(axis)}, {"long_name": long_name})

    @cached_property
    def radiographs(self) -> dict[str, Radiograph]:
        """The mammograms by name."""
        if "radiographs" not in self._root:
            text = "no mammogram in these results"
            raise MissingError(text, "mammogram", "ask for one: [compress] and [mammogram] in the study")
        group = self._root.group("radiographs")
        return {name: Radiograph(self, name, group.group(name)) for name in group.names()}

    @cached_property
    def metrics(self) -> Metrics:
        """The numbers of the report by name."""
        return read_metrics(self._root.group("metrics"))

    def _part(self, what: str, stage: str, *words: str) -> Metrics:
        found = self.metrics.starting(*words)
        if not found:
            raise MissingError(f"no {what} in these results", stage)
        return found

    @property
    def comfort(self) -> Metrics:
        """Force, contact area, pressure, percentiles of stress and strain at the end of the compression."""
        words = ("thickness", "nominal_thickness", "deflection", "force", "contact", "front", "face", "juxtathoracic")
        words += ("mean_pressure", "peak_pressure", "pressure", "mat", "von_mises", "largest_stress", "smallest_stress", "smallest_strain", "strain", "stretch")
        return self._part("comfort metrics", "comfort", *words)

    @property
    def quality(self) -> Metrics:
        """Signal and contrast over noise."""
        return self._part("image quality", "quality", "snr", "sdnr")

    @property
    def dose(self) -> Metrics:
        """Average glandular dose, and what it is made of."""
        return self._part("dose", "quality", "agd", "kerma", "dance")

    @cached_property
    def techniques(self) -> list[Technique]:
        """Exposure of each mammogram, in the order of their names."""
        return [picture.technique for picture in self.radiographs.values()]

    @cached_property
    def phantom(self) -> tuple[Surface, dict, float]:
        """Compressed surface in the detector's frame, plan of the picture, distance of the plates (mm)."""
        return read_phantom(self)

    def __repr__(self) -> str:
        lines = [f"mammotwin results of {self.subject} (mammotwin {self.program_version})"]
        lines.append("  poses:      " + ", ".join(f"{p.name} ({_word(p)})" for p in self.poses.values()))
        lines.append("  states:     " + ", ".join(self.states))
        lines.append("  curves:     " + ", ".join(self.curves))
        if "radiographs" in self._root:
            lines.append("  mammograms: " + ", ".join(self._root.group("radiographs").names()))
        lines.append(f"  metrics:    {len(self.metrics)}")
        return "\n".join(lines)


def _word(pose: Pose) -> str:
    return "reference" if pose.is_reference else pose.use


def _attributes(dataset: h5py.Dataset) -> dict[str, str]:
    return {name: str(dataset.attrs[name]) for name in ("units", "long_name")}
