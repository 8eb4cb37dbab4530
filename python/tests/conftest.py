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
def results(path):
    with mammotwin.open(path) as opened:
        yield opened


@pytest.fixture(scope="session")
def raw(path):
    with h5py.File(path) as opened:
        yield opened


@pytest.fixture(scope="session")
def study(results):
    """Folder of the study whose run the results are."""
    folder = results.path.parent.parent
    if not (folder / "study.toml").exists():
        pytest.skip("the results lie in no run of a digital volunteer")
    return folder


@pytest.fixture(scope="session")
def program():
    path = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin"))
    if not path.exists():
        pytest.skip("no program: build it, or set MAMMOTWIN")
    return path
