"""The Python of the documents runs, and the package installs and knows its version."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mammotwin

ROOT = Path(__file__).resolve().parents[2]


def blocks(path):
    return re.findall(r"```python\n(.*?)```", path.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("document", ["docs/python.md", "python/README.md", "README.md"])
def test_the_code_of_a_document_runs(document, study, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    found = blocks(ROOT / document)
    assert found
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "demo").symlink_to(study.resolve())
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in found:
        exec(compile(code, document, "exec"), names)
    names["results"].close()


def test_the_table_of_metrics_in_the_layout_document(results, tmp_path, monkeypatch):
    (code,) = blocks(ROOT / "docs/hdf5.md")
    (tmp_path / "results.h5").symlink_to(results.path.resolve())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert list(names["table"]["name"]) == list(results.metrics)


def test_the_version_is_that_of_the_program():
    cargo = re.search(r'^version = "([^"]+)"', (ROOT / "Cargo.toml").read_text(), flags=re.MULTILINE)
    project = re.search(r'^version = "([^"]+)"', (ROOT / "python/pyproject.toml").read_text(), flags=re.MULTILINE)
    assert mammotwin.__version__ == project.group(1) == cargo.group(1)


def test_it_installs_from_its_folder(tmp_path):
    pytest.importorskip("flit_core")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", tmp_path / "site", ROOT / "python"], check=True)
    code = "import mammotwin; print(mammotwin.__file__)"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(str(tmp_path)), "the installed package, not the folder of the sources"
    assert {path.name for path in (tmp_path / "site" / "mammotwin").glob("*.py")} == {
        path.name for path in (ROOT / "python/src/mammotwin").glob("*.py")
    }


def test_modules_are_short_and_say_what_they_are():
    for path in [*(ROOT / "python").rglob("*.py"), *(ROOT / "tests/python").glob("*.py")]:
        text = path.read_text()
        assert text.startswith('"""'), f"{path}: begin with a docstring"
        assert len(text.splitlines()) <= 500, f"{path}: split it"
