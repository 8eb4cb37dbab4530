"""What can be wrong with a file or a run folder, and what to do about it."""

from __future__ import annotations


class MammotwinError(Exception):
    """Any refusal of this package."""


class NotResultsError(MammotwinError, ValueError):
    """The file is no `results.h5` of mammotwin, or is damaged."""


class SchemaError(MammotwinError, ValueError):
    """The file has another version of the layout, or another coordinate system."""


class MissingError(MammotwinError, LookupError):
    """Something is not in the results; `stage` is the stage that makes it."""

    def __init__(self, what: str, stage: str, hint: str = "") -> None:
        self.what = what
        self.stage = stage
        remedy = hint or f"run it: mammotwin run STUDY.toml --until {stage}"
        super().__init__(f"{what}: comes from the stage `{stage}`; {remedy}")


class OptionalPackageError(MammotwinError, ImportError):
    """A package that only some functions need is not installed."""


def need(module: str, extra: str):
    """Imports an optional package, or says which extra brings it."""
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError as cause:
        text = f"{module} is not installed: pip install 'mammotwin[{extra}]'"
        raise OptionalPackageError(text) from cause
