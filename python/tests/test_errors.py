"""Refusals say what is wrong and which stage helps."""

import json
import shutil
import sys

import h5py
import numpy as np
import pytest

import mammotwin
from mammotwin import MissingError, NotResultsError, OptionalPackageError, SchemaError


def results_file(path, schema=2, system="RAS mm", **study):
    """A file as small as `results.h5` can be."""
    plan = {"schema": 1, "subject": {"id": "x"}, "model": {}, "poses": {"prone": {"use": "fit"}}, **study}
    with h5py.File(path, "w") as file:
        file.attrs["schema_version"] = schema
        file.attrs["coordinate_system"] = system
        file["parameters"] = json.dumps(plan)
        for name in ("stage", "of", "key", "content"):
            file[f"provenance/{name}"] = np.array([], dtype=h5py.string_dtype())
        file["provenance/program_version"] = "0"
        for name in ("name", "unit", "long_name", "source"):
            file[f"metrics/{name}"] = np.array([], dtype=h5py.string_dtype())
        file["metrics/value"], file["metrics/thesis"] = np.array([]), np.array([])
    return path


def test_no_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        mammotwin.open(tmp_path / "results.h5")


def test_another_kind_of_file(tmp_path):
    text = tmp_path / "results.h5"
    text.write_text("no HDF5")
    with pytest.raises(NotResultsError, match="no HDF5 file"):
        mammotwin.open(text)
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["numbers"] = [1, 2]
    with pytest.raises(NotResultsError, match="no attribute schema_version"):
        mammotwin.open(other)
    study = tmp_path / "study.toml"
    study.write_text("schema = 1")
    with pytest.raises(NotResultsError, match="give its run folder"):
        mammotwin.open(study)


def test_a_truncated_file(tmp_path):
    path = results_file(tmp_path / "results.h5")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(NotResultsError, match="damaged"):
        mammotwin.open(path)


@pytest.mark.parametrize(("version", "remedy"), [(3, "update this package"), (1, "run the study again")])
def test_another_version_of_the_layout(tmp_path, version, remedy):
    path = results_file(tmp_path / "results.h5", schema=version)
    with pytest.raises(SchemaError, match=f"layout {version}, this package reads 2; {remedy}"):
        mammotwin.open(path)
    # The file was let go: it may be replaced where open files may not.
    path.unlink()


def test_another_coordinate_system(tmp_path):
    with pytest.raises(SchemaError, match="'LPS mm'"):
        mammotwin.open(results_file(tmp_path / "results.h5", system="LPS mm"))


def test_a_folder_without_results(tmp_path):
    with pytest.raises(MissingError, match="mammotwin run STUDY.toml") as refused:
        mammotwin.open(tmp_path)
    assert refused.value.stage == "results"


def test_what_a_study_did_not_ask_for_names_its_stage(tmp_path):
    with mammotwin.open(results_file(tmp_path / "results.h5")) as results:
        for what, stage in (
            (lambda: results.compression, "compress"),
            (lambda: results.radiographs, "mammogram"),
            (lambda: results.quality, "quality"),
            (lambda: results.dose, "quality"),
            (lambda: results.comfort, "comfort"),
            (lambda: results.curve("force_thickness"), "compress"),
            (lambda: results.mesh, "mesh"),
        ):
            with pytest.raises(MissingError) as refused:
                what()
            assert refused.value.stage == stage and f"`{stage}`" in str(refused.value)
        assert results.curves == [] and results.states == {}
        assert "prone (reference)" in repr(results)


def test_a_missing_dataset_is_named(tmp_path):
    path = results_file(tmp_path / "results.h5")
    with h5py.File(path, "a") as file:
        del file["metrics/value"]
    with mammotwin.open(path) as results, pytest.raises(NotResultsError, match="no dataset /metrics/value"):
        _ = results.metrics


def test_results_without_their_folder_name_the_stage(results, tmp_path):
    alone = tmp_path / "results.h5"
    shutil.copy(results.path, alone)
    pose = next((p.name for p in results.poses.values() if p.use == "validate"), None)
    if pose is None:
        pytest.skip("no held-out pose")
    with mammotwin.open(alone) as copy:
        assert copy.compression.force_n == results.compression.force_n, "what is in the file itself is there"
        assert copy.poses[pose].to_reference.angle_deg == results.poses[pose].to_reference.angle_deg
        for when in ("before", "after"):
            own, other = getattr(copy.poses[pose], when), getattr(results.poses[pose], when)
            assert own.distances == other.distances and np.array_equal(own.signed_mm, other.signed_mm)
        assert copy.calibration.after == results.calibration.after
        assert copy.compression.stopped_early == results.compression.stopped_early
        picture = next(iter(copy.radiographs.values()))
        assert picture.technique.kerma_mgy > 0 and picture.regions
        with pytest.raises(MissingError, match="open the run folder") as refused:
            _ = copy.poses[pose].measured_skin
        assert refused.value.stage == f"surface:{pose}"
        with pytest.raises(MissingError, match="`mesh`"):
            _ = copy.mesh


def test_results_of_another_run_are_not_mixed(results, tmp_path):
    """A stage that was written anew since, and one that is gone."""
    record = next(r for r in results.provenance if r.stage == "surface")
    slot = results.folder.file(record.stage, record.of).parent
    there = tmp_path / "cache" / record.stage / slot.name
    shutil.copytree(slot, there)
    shutil.copy(results.path, tmp_path / "results.h5")
    with mammotwin.open(tmp_path) as copy:
        assert len(copy.poses[record.of].measured_skin.points) > 0
    written = json.loads((there / "record.json").read_text())
    (there / "record.json").write_text(json.dumps({**written, "content": "0" * 64}))
    with mammotwin.open(tmp_path) as copy:
        with pytest.raises(MissingError, match="not of one run"):
            _ = copy.poses[record.of].measured_skin
        with pytest.raises(MissingError, match="mammotwin run STUDY.toml --until mesh"):
            _ = copy.mesh


def test_the_reference_pose_is_compared_with_nothing(results):
    pose = results.poses[results.reference_pose]
    with pytest.raises(MissingError, match="nothing is compared"):
        _ = pose.after
    with pytest.raises(MissingError, match="others are registered to it"):
        _ = pose.registration


def test_a_missing_package_says_how_to_get_it(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(OptionalPackageError, match=r"pip install 'mammotwin\[mesh\]'"):
        results.mesh.to_pyvista()


def test_a_wrong_word_is_refused(results):
    from mammotwin import plots

    with pytest.raises(ValueError, match="'RAS' or 'LPS'"):
        results.mesh.to_meshio("RSA")
    with pytest.raises(KeyError, match="no patch 'nose'; there are"):
        results.mesh.surface("nose")
    pytest.importorskip("matplotlib").use("Agg")
    with pytest.raises(ValueError, match="'paddle' or 'receptor'"):
        plots.pressure_map(results.compression, "above")
