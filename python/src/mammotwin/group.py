"""Plain access to HDF5 with the conventions of mammotwin: units, texts, JSON."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from .errors import NotResultsError
from .fields import Field, Kind


def open_file(path: Path) -> h5py.File:
    """Opens an HDF5 file for reading, or says what is wrong with it."""
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        return h5py.File(path, "r")
    except OSError as cause:
        raise NotResultsError(f"{path}: no HDF5 file, or a damaged one: {cause}") from cause


class OpenFile:
    """A file that is read when it is asked for. Use as a context manager, or `close()` it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._h5 = open_file(path)
        try:
            self._check()
        except Exception:
            self._h5.close()
            raise

    def _check(self) -> None:
        """Refuses a file of another kind."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; what was read stays."""
        self._h5.close()

    @property
    def h5(self) -> h5py.File:
        """The open file, for all that this class does not know."""
        return self._h5

    @cached_property
    def _root(self) -> Group:
        return Group(self._h5)


class Group:
    """A group of a file, read by name."""

    def __init__(self, group: h5py.Group) -> None:
        self.h5 = group

    def __contains__(self, name: str) -> bool:
        return name in self.h5

    def names(self) -> list[str]:
        """Names of what is in the group."""
        return list(self.h5)

    def group(self, name: str) -> Group:
        """A group in this one."""
        return Group(self._item(name, h5py.Group))

    def array(self, name: str) -> np.ndarray:
        """Numbers of a dataset."""
        return self._item(name, h5py.Dataset)[()]

    def number(self, name: str) -> float:
        """One number."""
        return float(self.array(name))

    def text(self, name: str) -> str:
        """One text."""
        return self._item(name, h5py.Dataset).asstr()[()]

    def texts(self, name: str) -> list[str]:
        """A column of texts."""
        return list(self._item(name, h5py.Dataset).asstr()[()])

    def json(self, name: str) -> Any:
        """A value that is kept as JSON text."""
        return json.loads(self.text(name))

    def units(self, name: str) -> str:
        """Unit of a dataset."""
        return str(self._item(name, h5py.Dataset).attrs["units"])

    def field(self, name: str, kind: Kind = "scalar") -> Field:
        """A dataset with its unit and meaning."""
        dataset = self._item(name, h5py.Dataset)
        short = name.rsplit("/", 1)[-1]
        return Field(short, dataset[()], str(dataset.attrs["units"]), str(dataset.attrs["long_name"]), kind)

    def _item(self, name: str, kind: type):
        item = self.h5.get(name)
        if not isinstance(item, kind):
            place = f"{self.h5.name.rstrip('/')}/{name}"
            raise NotResultsError(f"{self.h5.file.filename}: no {kind.__name__.lower()} {place}; see docs/hdf5.md")
        return item
