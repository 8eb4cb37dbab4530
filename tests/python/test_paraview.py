"""ParaView itself opens `results.h5` and the meshes of the reader, and finds every node and value where they are.

Needs Debian's paraview and python3-paraview, the reader with meshio, and MAMMOTWIN_RESULTS; skipped without.
"""

import os
import shutil
import subprocess
from pathlib import Path

import numpy
import pytest

RESULTS = os.environ.get("MAMMOTWIN_RESULTS")
PARAVIEW = shutil.which("pvpython")
pytestmark = [
    pytest.mark.skipif(not RESULTS, reason="no results: set MAMMOTWIN_RESULTS"),
    pytest.mark.skipif(not PARAVIEW, reason="no ParaView: apt-get install paraview python3-paraview"),
]

#: Runs in ParaView: opens a file as its window does, and writes down what it read.
LOOK = """
import sys
import numpy
from paraview import servermanager
from paraview.simple import OpenDataFile
from vtk.util.numpy_support import vtk_to_numpy

path, out = sys.argv[1:]
reader = OpenDataFile(path)
reader.UpdatePipeline()
data = servermanager.Fetch(reader)
found = {"points": vtk_to_numpy(data.GetPoints().GetData())}
for kind, fields in (("point", data.GetPointData()), ("cell", data.GetCellData())):
    for n in range(fields.GetNumberOfArrays()):
        found[f"{kind}/{fields.GetArrayName(n)}"] = vtk_to_numpy(fields.GetArray(n))
found["cells"] = numpy.array([[data.GetCell(n).GetPointId(k) for k in range(4)] for n in range(data.GetNumberOfCells())])
numpy.savez(out, **found)
"""


def opened(path, folder):
    script, out = folder / "look.py", folder / f"{path.name}.npz"
    script.write_text(LOOK)
    command = [PARAVIEW, "--force-offscreen-rendering", script, path, out]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert out.exists(), done.stdout + done.stderr
    return numpy.load(out)


@pytest.mark.parametrize("name", ["results.hdf", "compressed.vtu"])
def test_paraview_opens_it_in_its_place(name, tmp_path):
    mammotwin = pytest.importorskip("mammotwin")
    pytest.importorskip("meshio")
    mesh = mammotwin.open(RESULTS).states["compressed"].mesh
    if name == "results.hdf":
        # The ending by which ParaView knows the format.
        (tmp_path / name).symlink_to(Path(RESULTS).resolve())
    else:
        mesh.save(tmp_path / name)
    found = opened(tmp_path / name, tmp_path)
    numpy.testing.assert_array_equal(found["cells"], mesh.tets)
    numpy.testing.assert_allclose(found["points"], mesh.points, atol=1e-9)
    # A mirrored body would be another one.
    assert not numpy.allclose(found["points"], mesh.points * (-1, 1, 1), atol=1)
    for kind, fields in (("point", mesh.point_fields), ("cell", mesh.cell_fields)):
        shared = [field for field in fields if f"{kind}/{field}" in found.files]
        assert len(shared) >= 3
        for field in shared:
            seen = found[f"{kind}/{field}"]
            numpy.testing.assert_allclose(seen, numpy.reshape(fields[field].values, seen.shape), atol=1e-12)
