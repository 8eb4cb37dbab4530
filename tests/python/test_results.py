"""Other programs read `results.h5`: h5py, pyvista and xarray.

The file is named by the environment variable MAMMOTWIN_RESULTS; without it the tests are skipped.
The layout that they check is the one of docs/hdf5.md.
"""

import json
import os
import re

import h5py
import numpy as np
import pytest

PATH = os.environ.get("MAMMOTWIN_RESULTS")
pytestmark = pytest.mark.skipif(not PATH, reason="no results: set MAMMOTWIN_RESULTS")


@pytest.fixture(scope="module")
def file():
    with h5py.File(PATH, "r") as opened:
        yield opened


def datasets(group):
    found = {}
    group.visititems(lambda name, item: found.update({name: item}) if isinstance(item, h5py.Dataset) else None)
    return found


def texts(dataset):
    return list(dataset.asstr()[()])


def texts_of(dataset):
    return dataset.asstr()[()]


def test_root(file):
    assert file.attrs["coordinate_system"] == "RAS mm"
    assert file.attrs["schema_version"] == 2
    assert {"metrics", "parameters", "provenance"} <= set(file)


def test_every_dataset_says_its_units_and_its_meaning(file):
    for name, dataset in datasets(file).items():
        assert dataset.attrs["units"], name
        assert len(dataset.attrs["long_name"]) > 2, name


def test_the_compressed_breast_lies_where_the_poses_lie(file):
    if "compression" not in file:
        pytest.skip("no compression")
    whole = file["calibration/rest/points"][()]
    for point in file["compression/rest/points"][()][::20]:
        assert np.linalg.norm(whole - point, axis=1).min() < 1e-6, point


def test_every_number_is_finite(file):
    for name, dataset in datasets(file).items():
        if dataset.dtype.kind == "f" and name not in ("metrics/thesis", "metrics/sd"):
            assert np.isfinite(dataset[()]).all(), name


def test_a_unit_in_a_name_is_the_unit_of_the_dataset(file):
    endings = {"mm": "mm", "mm2": "mm2", "n": "N", "kpa": "kPa", "mgy": "mGy", "kev": "keV", "deg": "deg"}
    for name, dataset in datasets(file).items():
        ending = re.search(r"(?<!_per)_(mm2?|n|kpa|mgy|kev|deg)$", name)
        if ending:
            assert dataset.attrs["units"] == endings[ending.group(1)], name


def test_grid(file):
    if "VTKHDF" not in file:
        pytest.skip("no equilibrium state in this study")
    grid = file["VTKHDF"]
    assert grid.attrs["Type"] == b"UnstructuredGrid"
    assert h5py.check_string_dtype(grid.attrs.get_id("Type").dtype).encoding == "ascii"
    assert list(grid.attrs["Version"]) == [1, 0]
    nodes, cells = int(grid["NumberOfPoints"][0]), int(grid["NumberOfCells"][0])
    assert grid["Points"].shape == (nodes, 3)
    assert grid["Connectivity"].shape == (4 * cells,)
    assert grid["Connectivity"][()].min() >= 0 and grid["Connectivity"][()].max() < nodes
    assert np.array_equal(grid["Offsets"][()], 4 * np.arange(cells + 1))
    assert (grid["Types"][()] == 10).all()
    assert all(len(field) == nodes for field in grid["PointData"].values())
    assert all(len(field) == cells for field in grid["CellData"].values())


def states(file):
    """(name, stress-free shape, solution) of every state of equilibrium."""
    for name, pose in file["poses"].items():
        yield name, file["calibration/rest"], pose["solution"]
    if "compression" in file:
        yield "compression", file["compression/rest"], file["compression/solution"]


def test_states(file):
    found = list(states(file))
    assert found
    for name, rest, solution in found:
        nodes, cells = len(rest["points"]), len(rest["tets"])
        assert solution["points"].shape == (nodes, 3), name
        assert solution["mean_stress_kpa"].shape == (nodes,), name
        assert solution["deformation_gradient"].shape == (cells, 3, 3), name
        assert solution["cauchy_kpa"].shape == (cells, 3, 3), name
        assert rest["tissues"].shape == (cells,), name
        # F is written row by row: it maps edges of the rest shape to edges of the state.
        corners = rest["tets"][()]
        edges = lambda points: np.stack([points[corners[:, n]] - points[corners[:, 0]] for n in (1, 2, 3)], axis=-1)
        now, before = edges(solution["points"][()]), edges(rest["points"][()])
        gradient = solution["deformation_gradient"][()]
        np.testing.assert_allclose(gradient @ before, now, atol=1e-6, err_msg=name)
        stress = solution["cauchy_kpa"][()]
        np.testing.assert_allclose(stress, np.swapaxes(stress, 1, 2), atol=1e-9 * max(1, abs(stress).max()))
        assert len(solution["forces/names"]) == len(solution["forces/force_n"]), name
        trace = np.trace(stress, axis1=1, axis2=2) / 3.0
        mean = solution["mean_stress_kpa"][()]
        assert trace.min() - 1e-9 <= mean.min() and mean.max() <= trace.max() + 1e-9, name


def test_units_are_those_of_udunits(file):
    """ASCII powers, no blank, forces in N: what xarray with pint or cf-units reads."""
    found = {dataset.attrs["units"] for dataset in datasets(file).values()} | set(texts(file["metrics/unit"]))
    known = {"mm", "mm2", "cm2", "cm3", "1/mm2", "N", "kPa", "deg", "mGy", "mGy/mGy", "keV", "1", "text", "see unit"}
    assert found <= known, found - known


def test_motions_are_rigid_and_gravity_is_a_unit_vector(file):
    roles = [texts_of(pose["role"]) for pose in file["poses"].values()]
    assert roles.count("reference") == 1 and set(roles) <= {"reference", "fit", "validate"}
    motions = [pose["to_reference"] for pose in file["poses"].values() if "to_reference" in pose]
    assert len(motions) == len(roles) - 1
    if "compression" in file:
        motions.append(file["compression/to_detector"])
    for motion in motions:
        rotation = motion["rotation"][()]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0 and motion["translation_mm"].shape == (3,)
    for pose in file["poses"].values():
        assert abs(np.linalg.norm(pose["gravity"][()]) - 1.0) < 1e-9


def test_metrics(file):
    metrics = file["metrics"]
    names = texts(metrics["name"])
    assert len(set(names)) == len(names)
    for column in ("value", "thesis", "unit", "source", "long_name"):
        assert metrics[column].shape == (len(names),)
    assert all(texts(metrics["source"])), "every number has a source"


def test_parameters_and_provenance_name_no_file(file):
    study = json.loads(file["parameters"].asstr()[()])
    assert study["schema"] == 1 and study["subject"]["id"]
    for pose in study["poses"].values():
        assert not {"image", "landmarks", "labels"} & set(pose)
    provenance = file["provenance"]
    assert file["provenance/program_version"].asstr()[()]
    lengths = {len(provenance[name]) for name in ("stage", "of", "key", "content")}
    assert len(lengths) == 1


def test_pyvista_opens_the_mesh_and_its_fields(file):
    pyvista = pytest.importorskip("pyvista")
    if "VTKHDF" not in file:
        pytest.skip("no equilibrium state in this study")
    # The reader is named, since pyvista does not know it by the ending `.h5`.
    mesh = pyvista.HDFReader(PATH).read()
    assert mesh.n_cells == int(file["VTKHDF/NumberOfCells"][0])
    np.testing.assert_array_equal(mesh.points, file["VTKHDF/Points"][()].astype(mesh.points.dtype))
    for name in ("displacement_mm", "mean_stress_kpa"):
        np.testing.assert_array_equal(mesh.point_data[name], file[f"VTKHDF/PointData/{name}"][()])
    for name in ("tissue", "von_mises_kpa", "principal_stretches", "volume_ratio"):
        np.testing.assert_array_equal(mesh.cell_data[name], file[f"VTKHDF/CellData/{name}"][()])
    volumes = mesh.compute_cell_sizes(length=False, area=False)["Volume"]
    assert (volumes > 0).all(), "no tetrahedron is turned inside out"
    stretches = mesh.cell_data["principal_stretches"]
    np.testing.assert_allclose(stretches.prod(axis=1), mesh.cell_data["volume_ratio"], rtol=1e-6)
    assert (np.diff(stretches, axis=1) <= 0).all(), "largest first"


def test_xarray_opens_the_curves(file):
    xarray = pytest.importorskip("xarray")
    if "curves" not in file:
        pytest.skip("no curve in this study")
    for name, group in file["curves"].items():
        scales = [key for key, item in group.items() if item.is_scale]
        assert len(scales) == 1, name
        with xarray.open_dataset(PATH, group=f"curves/{name}", engine="h5netcdf") as curve:
            assert list(curve.dims) == scales, name
            assert list(curve.coords) == scales, name
            assert len(curve.data_vars) >= 1, name
            for variable in curve.data_vars.values():
                assert variable.dims == (scales[0],)
                assert variable.attrs["units"]
    if "force_thickness" in file["curves"]:
        with xarray.open_dataset(PATH, group="curves/force_thickness", engine="h5netcdf") as curve:
            thickness, force = curve["thickness_mm"], curve["force_n"]
            assert thickness.attrs["units"] == "mm" and force.attrs["units"] == "N"
            assert (np.diff(thickness) < 0).all(), "the plates approach"
