"""What the reader says is what the file holds, and what the numbers themselves imply."""

import dataclasses

import h5py
import numpy as np
import pytest

import mammotwin
from mammotwin import Tissue


def close(a, b, rel=1e-9, abs=1e-9):
    return a == pytest.approx(b, rel=rel, abs=abs)


def test_a_file_its_folder_and_the_study_open_alike(path, opened):
    with mammotwin.open(path.parent) as other:
        assert other.path == opened.path
    if path.parent.name == "out":
        with mammotwin.open(path.parent.parent) as other:
            assert other.path == opened.path


def test_it_tells_what_it_holds(opened):
    text = repr(opened)
    assert opened.subject in text
    for name in [*opened.poses, *opened.states, *opened.curves]:
        assert name in text


def test_poses(results):
    first, *others = results.poses.values()
    assert first.is_reference and first.name == results.reference_pose
    assert np.array_equal(first.to_reference.matrix, np.eye(4))
    for pose in others:
        assert not pose.is_reference and pose.use in ("fit", "validate")
        np.testing.assert_allclose(pose.to_reference.rotation @ pose.to_reference.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.to_reference.rotation) == pytest.approx(1.0)
        assert pose.registration.similarity_after > pose.registration.similarity_before
        assert (pose.registration.sd_translation_mm > 0).all()


def test_states(opened, raw):
    for name, state in opened.states.items():
        rest, mesh = state.rest, state.mesh
        group = raw["compression" if name == "compressed" else f"poses/{name}"]
        shape = raw["compression/rest" if name == "compressed" else "calibration/rest"]
        assert np.array_equal(mesh.points, group["solution/points"][()])
        assert np.array_equal(mesh.tets, shape["tets"][()])
        assert set(mesh.patches) == set(shape["patches"])
        moved = mesh.point_fields["displacement_mm"]
        assert moved.units == "mm" and moved.kind == "vector"
        np.testing.assert_allclose(rest.points + moved.values, mesh.points, atol=1e-12)
        assert (mesh.volumes_mm3 > 0).all() and (rest.volumes_mm3 > 0).all()
        ratio = mesh.cell_fields["volume_ratio"].values
        np.testing.assert_allclose(mesh.volumes_mm3 / rest.volumes_mm3, ratio, rtol=1e-6)
        assert ratio.min() == pytest.approx(state.checks.min_det_f, rel=1e-9)
        forces = state.forces_n
        largest = max(np.linalg.norm(force) for force in forces.values())
        assert np.linalg.norm(sum(forces.values())) <= 1e-5 * largest
        for field in [*mesh.point_fields.values(), *mesh.cell_fields.values()]:
            assert field.units and field.long_name and field.name in repr(field)


def test_gravity_pulls_as_the_pose_says(results):
    for pose in results.poses.values():
        if pose.is_reference:
            continue
        force = pose.state.forces_n["gravity"]
        np.testing.assert_allclose(force / np.linalg.norm(force), pose.after.gravity, atol=1e-9)
        np.testing.assert_array_equal(pose.gravity, pose.after.gravity)
        assert np.linalg.norm(pose.gravity) == pytest.approx(1.0)


def test_what_results_say_of_poses_is_what_their_stages_say(results):
    """Motions, gravity and distances stand in two files."""
    from mammotwin import RigidTransform

    for name, pose in results.poses.items():
        if pose.is_reference:
            continue
        stage = results.folder.json("register", name)
        motion = RigidTransform.from_json(stage["transform"])
        # The program reads a number of JSON to the last bit but one.
        np.testing.assert_allclose(pose.to_reference.rotation, motion.rotation, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(pose.to_reference.translation_mm, motion.translation_mm, rtol=1e-14)
        np.testing.assert_allclose(pose.gravity, stage["gravity"], rtol=1e-14, atol=1e-15)
        degrees = np.degrees(stage["image"]["uncertainty"]["rotation_rad"])
        np.testing.assert_allclose(pose.registration.sd_rotation_deg, degrees, rtol=1e-12)
        of, group = (name, "{}") if pose.use == "validate" else ("", "{}/fits/" + name)
        with results.folder.open("validate" if of else "calibrate", of) as file:
            for when in ("before", "after"):
                fit, there = getattr(pose, when), file.group(group.format(when))
                np.testing.assert_array_equal(fit.signed_mm, there.array("signed_distance"))
                np.testing.assert_array_equal(fit.nodes, there.array("active"))
                assert fit.distances.modified_hausdorff_mm == there.json("distances")["modified_hausdorff"]
                skin = there.array("solution/points")[fit.skin.nodes]
                np.testing.assert_array_equal(fit.skin.points, skin)


def test_before_and_after_differ_where_moduli_do(results):
    found = results.calibration
    if found.before == found.after:
        pytest.skip("nothing was fitted")
    for pose in results.poses.values():
        if not pose.is_reference:
            assert np.abs(pose.before.skin.points - pose.after.skin.points).max() > 1e-3


def test_load_steps_lead_to_the_end(results):
    compression = results.compression
    steps = compression.steps
    assert steps.sizes["thickness_mm"] == compression.curve.sizes["thickness_mm"]
    last = steps.isel(thickness_mm=-1)
    mesh = compression.state.mesh
    np.testing.assert_allclose(last["points"], mesh.points, atol=1e-4)
    np.testing.assert_allclose(last["contact_pressure_kpa"], compression.contact_pressure.values, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(last["von_mises_kpa"], mesh.cell_fields["von_mises_kpa"].values, rtol=1e-4, atol=1e-5)
    peaks = steps["contact_pressure_kpa"].max("node")
    np.testing.assert_allclose(peaks, compression.curve["peak_pressure_kpa"], rtol=1e-5, atol=1e-6)
    assert steps["points"].attrs["units"] == "mm"
    receptor, paddle = steps["plates_mm"].values.T
    assert receptor[-1] == pytest.approx(0.0, abs=1e-9)
    if not compression.curve["tilt_deg"].any():
        np.testing.assert_allclose(paddle - receptor, steps["thickness_mm"], atol=1e-9)


def test_the_nipple_of_the_compression(results):
    compression = results.compression
    placed = compression.to_detector(compression.state.mesh.points[compression.nipple_node])
    np.testing.assert_allclose(placed, compression.nipple_mm, atol=1e-6)
    # x of the detector begins at the nipple.
    assert compression.nipple_mm[0] == pytest.approx(0.0, abs=1e-6)


def test_fields_are_those_of_the_grid(results, raw):
    mesh = results.states["compressed"].mesh
    np.testing.assert_array_equal(mesh.points, raw["VTKHDF/Points"][()])
    for place, fields in (("PointData", mesh.point_fields), ("CellData", mesh.cell_fields)):
        for name, dataset in raw[f"VTKHDF/{place}"].items():
            if name == "tissue":
                np.testing.assert_array_equal(mesh.tissues, dataset[()])
                continue
            np.testing.assert_allclose(fields[name].values, dataset[()], rtol=1e-9, atol=1e-9)
            assert fields[name].units == dataset.attrs["units"]


def test_calibration(opened):
    found = opened.calibration
    trial = found.trials.isel(trial=found.best_trial)
    if found.fitted and len(found.trials["trial"]) > 1:
        assert close(float(trial["young_right_kpa"]), found.after.right_kpa)
        assert close(float(trial["young_left_kpa"]), found.after.left_kpa)
        fitted = [p for p in opened.poses.values() if p.use == "fit" and not p.is_reference]
        worst = max(p.after.distances.modified_hausdorff_mm for p in fitted)
        assert close(float(trial["modified_hausdorff_mm"]), worst)
    assert found.trials["young_right_kpa"].attrs["units"] == "kPa"
    assert len(found.rest.points) == len(opened.mesh.points)
    again = opened.states[opened.reference_pose].mesh.points
    assert np.linalg.norm(again - opened.mesh.points, axis=1).max() == pytest.approx(
        found.round_trip_max_mm, rel=1e-6, abs=1e-9
    )


def test_distances_follow_from_their_nodes(results):
    compared = [pose for pose in results.poses.values() if not pose.is_reference]
    for pose in compared:
        for fit in (pose.before, pose.after):
            away = np.abs(fit.signed_mm)
            assert close(away.max(), fit.distances.max_mm)
            assert close(away.min(), fit.distances.min_mm)
            assert close(away.mean(), fit.distances.mean_mm)
            assert fit.distances.modified_hausdorff_mm >= fit.distances.mean_mm - 1e-9
            assert fit.distances.hausdorff_mm >= fit.distances.max_mm - 1e-9
            values = fit.distance_map.point_fields["signed_distance_mm"].values
            assert np.isfinite(values).sum() == len(fit.nodes)
            assert close(np.nanmax(values), fit.signed_mm.max())
        # The simulation after the fit is the state in results.h5.
        skin = pose.after.skin
        np.testing.assert_array_equal(skin.points, pose.state.mesh.points[skin.nodes])
        assert np.isin(pose.after.nodes, skin.nodes).all()


def test_a_signed_distance_is_that_to_the_measured_skin(results):
    pyvista = pytest.importorskip("pyvista")
    pose = next(p for p in results.poses.values() if not p.is_reference)
    measured = pose.measured_skin.moved(pose.to_reference).to_pyvista()
    at = pyvista.PolyData(pose.state.mesh.points[pose.after.nodes])
    distance = at.compute_implicit_distance(measured)["implicit_distance"]
    # VTK's sign is positive outside of an outward surface, too. Voxel-sized steps may hide its sign near zero.
    np.testing.assert_allclose(np.abs(distance), np.abs(pose.after.signed_mm), atol=1e-3)
    far = np.abs(distance) > 0.5
    assert (np.sign(distance[far]) == np.sign(pose.after.signed_mm[far])).all()


def test_the_curve_is_an_xarray_dataset_with_units(results, raw):
    curve = results.compression.curve
    assert list(curve.coords) == ["thickness_mm"]
    group = raw["curves/force_thickness"]
    for name in group:
        np.testing.assert_array_equal(curve[name], group[name][()])
        assert curve[name].attrs["units"] == group[name].attrs["units"]
        assert curve[name].attrs["long_name"]
    assert float(curve["force_n"].sel(thickness_mm=results.compression.thickness_mm)) == results.compression.force_n


def test_comfort_follows_from_the_fields(results):
    """A second implementation of the percentiles."""
    compression, comfort = results.compression, results.comfort
    assert close(compression.thickness_mm, comfort["thickness_mm"].value)
    assert close(compression.force_n, comfort["force_n"].value)
    assert close(compression.contact_pressure.values.max(), comfort["peak_pressure_kpa"].value)
    for percent in (50, 95, 99):
        assert close(compression.von_mises_percentile_kpa(percent), comfort[f"von_mises_p{percent}_kpa"].value)
        assert close(compression.strain_percentile(percent), comfort[f"strain_p{percent}"].value)
        assert close(compression.principal_stress_percentile_kpa(percent), comfort[f"largest_stress_p{percent}_kpa"].value)
    for percent in (1, 5, 50):
        found = compression.principal_stress_percentile_kpa(percent, "smallest")
        assert close(found, comfort[f"smallest_stress_p{percent:02}_kpa"].value)
        assert close(compression.strain_percentile(percent, "smallest"), comfort[f"smallest_strain_p{percent:02}"].value)
    for axis, found in zip("xyz", compression.peak_pressure_place_mm, strict=True):
        assert close(found, comfort[f"peak_pressure_{axis}_mm"].value)
    for percent in (95, 99):
        assert close(compression.pressure_percentile_kpa(percent), comfort[f"pressure_p{percent}_kpa"].value)


def test_forces_of_the_plates_are_those_of_the_curve(results):
    """Along the way of the plates, z of the detector: the paddle pushes down, the receptor up; N, not mN."""
    compression = results.compression
    along = {name: compression.to_detector.direction(force)[2] for name, force in compression.state.forces_n.items()}
    last = compression.curve.isel(thickness_mm=-1)
    assert -along["paddle"] == pytest.approx(float(last["force_n"]), rel=1e-3, abs=1e-6)
    assert along["receptor"] == pytest.approx(float(last["receptor_force_n"]), rel=1e-3, abs=1e-6)


def rounded_plate_mm(y, height, radius=6.0):
    """Distance to a plate that begins at y = 0 with a round edge and fills all below height 0."""
    across, up = radius - y, height + radius
    corner = np.hypot(across, up)
    return np.where((across > 0) & (up > 0), corner, np.maximum(across, up)) - radius


def test_touched_skin_lies_on_the_plates(results):
    """The plates in the frame of the detector: their faces, their round edges, their fronts."""
    compression = results.compression
    placed = compression.pressure_map.moved(compression.to_detector)
    touched = placed.point_fields["contact_pressure_kpa"].values > 0
    assert touched.any()
    _, y, z = placed.points[touched].T
    receptor = rounded_plate_mm(y, z)
    paddle = rounded_plate_mm(y, compression.thickness_mm - z)
    np.testing.assert_allclose(np.minimum(receptor, paddle), 0.0, atol=0.05)
    assert (receptor < 0.05).any() and (paddle < 0.05).any()


def test_radiographs(results, raw):
    for name, picture in results.radiographs.items():
        array = picture.to_xarray()
        assert array.shape == raw[f"radiographs/{name}/pixels"].shape == (len(picture.y_mm), len(picture.x_mm))
        assert array.dims == ("y_mm", "x_mm") and array.attrs["units"] == "1"
        assert close(float(array["x_mm"][0]), raw[f"radiographs/{name}/left_mm"][()])
        assert close(picture.y_mm[1] - picture.y_mm[0], picture.pitch_mm)
        assert name.endswith(f"{1000 * picture.technique.diameter_mm:.0f}um")


def test_regions_are_those_of_the_metrics(results):
    """What the file holds and a second implementation of placement, shadow and quality: both agree to rounding."""
    for picture in results.radiographs.values():
        regions = picture.measured_again()
        for one, other in zip(picture.regions, regions, strict=True):
            assert (one.site.row, one.site.column) == (other.site.row, other.site.column)
            np.testing.assert_allclose(one.site.center_mm, other.site.center_mm, atol=1e-9)
            np.testing.assert_allclose(one.center_mm, other.center_mm, atol=1e-9)
            for name in ("calcification", "background", "snr", "sdnr", "snr_detrended", "sdnr_detrended"):
                assert close(getattr(one, name), getattr(other, name), rel=1e-6)
        size = picture.name.removeprefix("calcifications_")
        for name in ("snr", "snr_detrended", "sdnr", "sdnr_detrended"):
            values = [getattr(region, name) for region in regions]
            metric = results.quality[f"{name}_{size}_mean"]
            assert f"{len(regions)} regions" in metric.long_name
            assert close(np.mean(values), metric.value, rel=1e-6)
            assert close(np.std(values, ddof=1), results.quality[f"{name}_{size}_sd"].value, rel=1e-6)


def test_dose(results):
    dose = results.dose
    factors = dose["kerma_mgy"].value * dose["dance_g"].value * dose["dance_c"].value * dose["dance_s"].value
    assert close(factors, dose["agd_mgy"].value)
    assert dose["agd_mgy"].units == "mGy" and dose["agd_mgy"].thesis == 1.2
    assert close(results.techniques[0].kerma_mgy, dose["kerma_mgy"].value)


def test_metrics_are_a_mapping_and_a_table(opened, raw):
    metrics = opened.metrics
    assert list(metrics) == list(raw["metrics/name"].asstr()[()])
    np.testing.assert_array_equal([float(m) for m in metrics.values()], raw["metrics/value"][()])
    assert all(metric.units for metric in metrics.values()), "pure numbers have the unit 1"
    table = metrics.to_pandas()
    assert table.loc["round_trip_rms_mm", "units"] == "mm" and len(table) == len(metrics)
    with pytest.raises(KeyError, match="no metric 'nonsense'; there are"):
        metrics["nonsense"]


def test_provenance(opened):
    names = [record.name for record in opened.provenance]
    assert "calibrate" in names and opened.program_version
    assert all(len(record.key) == 64 for record in opened.provenance)


def test_tissues_and_parameters(opened):
    assert set(np.unique(opened.mesh.tissues)) <= {int(tissue) for tissue in Tissue}
    assert opened.parameters["schema"] == 1


def test_everything_is_read_only_by_design(opened):
    with pytest.raises(dataclasses.FrozenInstanceError):
        opened.mesh.points = None
    with pytest.raises((OSError, KeyError, ValueError)):
        opened.h5.create_group("mine")
    assert isinstance(opened.h5, h5py.File)
