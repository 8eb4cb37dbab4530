"""The numbers of the report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from .group import Group


@dataclass(frozen=True)
class Metric:
    """One number with its unit and source; `thesis` is the value of Mîra (2018), `sd` one standard deviation from the
    fitted moduli, where there is one."""

    name: str
    value: float
    units: str
    long_name: str
    source: str
    thesis: float | None
    sd: float | None = None

    def __float__(self) -> float:
        return self.value


class Metrics(Mapping[str, Metric]):
    """All numbers by name, in the order of the report."""

    def __init__(self, metrics: list[Metric]) -> None:
        self._metrics = {metric.name: metric for metric in metrics}

    def __getitem__(self, name: str) -> Metric:
        try:
            return self._metrics[name]
        except KeyError:
            raise KeyError(f"no metric {name!r}; there are {', '.join(self._metrics)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._metrics)

    def __len__(self) -> int:
        return len(self._metrics)

    def starting(self, *words: str) -> Metrics:
        """Those whose names start with one of the words."""
        return Metrics([metric for name, metric in self._metrics.items() if name.startswith(words)])

    def to_pandas(self):
        """A table with the names as index."""
        import pandas

        columns = ["value", "sd", "units", "thesis", "long_name", "source"]
        rows = [[getattr(metric, column) for column in columns] for metric in self.values()]
        return pandas.DataFrame(rows, index=pandas.Index(self, name="name"), columns=columns)

    def __repr__(self) -> str:
        number = lambda m: f"{m.value:.4g} {m.units}".strip()  # noqa: E731
        return "\n".join(f"{m.name:28} {number(m):>16}  {m.long_name}" for m in self.values())


def read_metrics(group: Group) -> Metrics:
    """Reads `/metrics`."""
    columns = [group.texts(name) for name in ("name", "unit", "long_name", "source")]
    values, thesis = group.array("value"), group.array("thesis")
    # Files of older versions have none.
    sds = group.array("sd") if "sd" in group else [math.nan] * len(values)
    known = lambda number: None if math.isnan(number) else float(number)  # noqa: E731
    return Metrics(
        [
            Metric(name, float(value), unit, long, source, known(other), known(sd))
            for name, unit, long, source, value, other, sd in zip(*columns, values, thesis, sds, strict=True)
        ]
    )
