"""The notebooks of examples/ run on the results at hand, and are those of their scripts."""

import os
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NAMES = ["force_curves", "calibration", "discovery"]


def test_all_notebooks_are_here():
    assert sorted(path.stem for path in EXAMPLES.glob("*.ipynb")) == sorted(NAMES)
    assert sorted(path.stem for path in EXAMPLES.glob("*.py")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_that_of_its_script_and_small(name):
    jupytext = pytest.importorskip("jupytext")
    script = jupytext.read(EXAMPLES / f"{name}.py")
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    content = lambda book: [(cell.cell_type, cell.source) for cell in book.cells]  # noqa: E731
    assert content(notebook) == content(script), "make it anew: scripts/notebooks"
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code), "it is executed"
    outputs = [output for cell in code for output in cell.outputs]
    assert outputs and not any(output.output_type == "error" for output in outputs)
    assert (EXAMPLES / f"{name}.ipynb").stat().st_size < 500_000
    assert "/tmp/" not in nbformat.writes(notebook) and "/home/" not in nbformat.writes(notebook)


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs(name, results, study):
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    client = nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3")
    if name == "discovery" and not os.environ.get("MAMMOTWIN_DISCOVERY"):
        pytest.skip("no discovery: set MAMMOTWIN_DISCOVERY")
    environment = {**os.environ, "MAMMOTWIN_RESULTS": str(Path(results.path).resolve())}
    client.execute(cwd=str(EXAMPLES), env=environment)
    pictures = [o for cell in notebook.cells for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]
    assert len(pictures) >= 2
