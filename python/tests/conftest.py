"""The results that the tests read are named by the environment variable MAMMOTWIN_RESULTS; without it most are skipped.

They should lie in the folder of a run of the volunteer `tiny`, with her images beside it. MAMMOTWIN names the program;
without it the one that was built in this repository is taken.
"""

import os
from pathlib import Path

import h5py
import pytest

import mammotwin

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def path():
    name = os.environ.get("MAMMOTWIN_RESULTS")
    if not name:
        pytest.skip("no results: set MAMMOTWIN_RESULTS")
    return Path(name)


@pytest.fixture(scope="session")
def opened(path):
    """Results of any study."""
    with mammotwin.open(path) as opened:
        yield opened


@pytest.fixture(scope="session")
def results(opened):
    """Results of a study with everything: several poses, a compression, a mammogram."""
    asked = opened.parameters
    if len(asked["poses"]) < 2 or not asked.get("compress") or not asked.get("mammogram"):
        pytest.skip("these tests need several poses, a compression and a mammogram")
    return opened


@pytest.fixture(scope="session")
def raw(path):
    with h5py.File(path) as opened:
        yield opened


@pytest.fixture(scope="session")
def study(opened):
    """Folder of the digital volunteer whose run the results are."""
    folder = opened.path.parent.parent
    if not (folder / "truth").exists():
        pytest.skip("the results lie in no run of a digital volunteer")
    return folder


@pytest.fixture(scope="session")
def program():
    named = os.environ.get("MAMMOTWIN")
    path = Path(named or ROOT / "target/release/mammotwin")
    if not path.exists():
        if named:
            pytest.fail(f"MAMMOTWIN: no {named}")
        pytest.skip("no program: build it, or set MAMMOTWIN")
    return path
