"""docs/hdf5.md and `results.h5` say the same: every dataset is in its tables, with its unit, and nothing else is."""

import os
import re
from pathlib import Path

import h5py
import pytest

PATH = os.environ.get("MAMMOTWIN_RESULTS")
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "hdf5.md"
#: Words of the document that stand for any name.
ANY = {"NAME", "PATCH", "SIDE", "KEY"}


def documented():
    """(pattern, unit) of every dataset in the tables below a heading that names a group."""
    found, group = [], None
    for line in DOCUMENT.read_text().splitlines():
        if line.startswith("#"):
            named = re.match(r"#+ `(/[^`]*)`", line)
            group = named and named.group(1)
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if group and line.startswith("| `") and len(cells) == 4:
            for name in re.findall(r"`([^`]+)`", cells[0]):
                path = name if name.startswith("/") else f"{group}/{name}"
                parts = ["[^/]+" if part in ANY else re.escape(part) for part in path.strip("/").split("/")]
                found.append((re.compile("/".join(parts)), cells[2]))
    return found


def test_the_document_has_tables():
    assert len(documented()) > 50


@pytest.mark.skipif(not PATH, reason="no results: set MAMMOTWIN_RESULTS")
def test_every_dataset_is_documented_with_its_unit():
    names = {}
    with h5py.File(PATH) as file:
        file.visititems(
            lambda name, item: names.update({name: item.attrs["units"]}) if hasattr(item, "shape") else None
        )
    tables = documented()
    for name, unit in names.items():
        units = [wanted for pattern, wanted in tables if pattern.fullmatch(name)]
        assert units, f"{name} is not in docs/hdf5.md"
        assert unit in units, f"{name}: unit {unit}, documented {units}"
    if "compression/rest/points" in names and any(name.startswith("radiographs/") for name in names):
        # Only a study with compress.clamp, with calibrate.second_start, that fits more than the breasts, or with a
        # deformable muscle, has them.
        asked = [
            group
            for group in (
                "curves/time_course/",
                "calibration/second_start/",
                "calibration/shared/",
                "calibration/muscle/",
                "compression/muscle/",
            )
            if not any(name.startswith(group) for name in names)
        ]
        # Only voxels that resolve skin give it a thickness.
        skin = any(name.endswith("/skin_median_mm") for name in names)
        for pattern, _ in tables:
            if any(pattern.pattern.startswith(re.escape(group)) for group in asked):
                continue
            # Of what may be fitted a study fits some.
            if re.fullmatch(r"curves/calibration/(skin|fascia|ligaments|breast)_\w+", pattern.pattern):
                continue
            if re.search(r"breasts/.*skin", pattern.pattern) and not skin:
                continue
            assert any(pattern.fullmatch(name) for name in names), f"{pattern.pattern} is in no file"
