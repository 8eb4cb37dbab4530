"""The run folder: results of single stages, found by what `results.h5` says it was made of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import MissingError, NotResultsError
from .group import Group, open_file


@dataclass(frozen=True)
class StageRecord:
    """A stage that contributed: its name, its pose, the key of what it read, the hash of what it made."""

    stage: str
    of: str
    key: str
    content: str

    @property
    def name(self) -> str:
        """As the command line has it: `validate:tilted`."""
        return f"{self.stage}:{self.of}" if self.of else self.stage


class RunFolder:
    """Finds the results of stages in `OUT/cache/STAGE/[POSE-]KEY/`."""

    def __init__(self, results: Path, records: list[StageRecord]) -> None:
        self.path = results.parent
        self.records = {(record.stage, record.of): record for record in records}

    def file(self, stage: str, of: str = "") -> Path:
        """The result of a stage, of the very run that wrote `results.h5`."""
        name = f"{stage}:{of}" if of else stage
        record = self.records.get((stage, of))
        if record is None:
            raise MissingError(f"{name} took no part in these results", name)
        short = record.key[:16]
        slot = self.path / "cache" / stage / (f"{of}-{short}" if of else short)
        if not (self.path / "cache").is_dir():
            text = f"{name} is not in results.h5 itself"
            hint = f"open the run folder that results.h5 was written to (no `cache` in {self.path})"
            raise MissingError(text, name, hint)
        try:
            written = json.loads((slot / "record.json").read_text())
        except (OSError, ValueError) as cause:
            raise MissingError(f"its result of {name} ({slot.name}) is not in {self.path / 'cache'}", name) from cause
        if written.get("content") != record.content:
            hint = "another run has written it since; run the study to its end: mammotwin run STUDY.toml"
            raise MissingError(f"results.h5 and the result of {name} are not of one run", name, hint)
        return slot / written["file"]

    def json(self, stage: str, of: str = "") -> Any:
        """The result of a stage that is kept as JSON."""
        path = self.file(stage, of)
        try:
            return json.loads(path.read_text())
        except ValueError as cause:
            raise NotResultsError(f"{path}: damaged; mammotwin verify STUDY.toml finds more") from cause

    @contextmanager
    def open(self, stage: str, of: str = "") -> Iterator[Group]:
        """The result of a stage that is kept as HDF5."""
        with open_file(self.file(stage, of)) as file:
            yield Group(file)
