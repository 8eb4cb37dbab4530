"""Everything opens in the right place: pyvista, meshio, nibabel (RAS), SimpleITK (LPS).

What is mirrored, turned or transposed would be far off: her breasts, poses and the compression are not symmetric.
"""

import csv

import numpy as np
import pytest

import mammotwin
from mammotwin import RigidTransform, Tissue

nibabel = pytest.importorskip("nibabel")
sitk = pytest.importorskip("SimpleITK")
pyvista = pytest.importorskip("pyvista")
meshio = pytest.importorskip("meshio")

RIGHT = (Tissue.ADIPOSE_RIGHT, Tissue.FIBROGLANDULAR_RIGHT)
LEFT = (Tissue.ADIPOSE_LEFT, Tissue.FIBROGLANDULAR_LEFT)
TO_LPS = np.array([-1.0, -1.0, 1.0])
#: A nipple of the mesh is the skin farthest from the chest wall: as near to the landmark (mm) as elements are long.
NIPPLE_MM = 15.0


def landmarks(study, pose):
    with open(study / f"{pose}_landmarks.csv") as file:
        return {row["name"]: np.array([float(row[f"{axis}_mm"]) for axis in "xyz"]) for row in csv.DictReader(file)}


def label_at(image, points):
    """Labels at places in RAS mm, by nibabel's affine."""
    values = np.asanyarray(image.dataobj)
    voxel = np.rint(nibabel.affines.apply_affine(np.linalg.inv(image.affine), points)).astype(int)
    assert ((voxel >= 0) & (voxel < values.shape)).all()
    return values[tuple(voxel.T)]


def test_her_right_is_plus_x_for_every_program(results):
    for name, pose in results.poses.items():
        image = pose.labels()
        labels = np.asanyarray(image.dataobj)
        seen = sitk.ReadImage(str(pose.labels_file))
        array = sitk.GetArrayFromImage(seen)  # k, j, i
        for tissue, sign in ((Tissue.ADIPOSE_RIGHT, 1), (Tissue.ADIPOSE_LEFT, -1)):
            voxel = np.argwhere(labels == tissue).mean(axis=0)
            ras = nibabel.affines.apply_affine(image.affine, voxel)
            assert sign * ras[0] > 30, f"{name}: {tissue.name} in RAS"
            index = np.argwhere(array == tissue).mean(axis=0)[::-1]
            lps = np.array(seen.TransformContinuousIndexToPhysicalPoint(index.tolist()))
            np.testing.assert_allclose(lps * TO_LPS, ras, atol=1e-3, err_msg=f"{name}: ITK is LPS")


def test_the_mesh_lies_in_the_labels(results):
    """Each tetrahedron lies in the body, and those of a side's breast among the voxels of that side."""
    image = results.poses[results.reference_pose].labels()
    mesh = results.mesh
    found = label_at(image, mesh.centers)
    assert np.mean(found != Tissue.BACKGROUND) > 0.99
    for tissues, others in ((RIGHT, LEFT), (LEFT, RIGHT)):
        inside = np.isin(mesh.tissues, tissues)
        assert inside.any() and not np.isin(found[inside], others).any()


def away_mm(surface, points):
    """Mean distance of points to a surface."""
    points = pyvista.PolyData(np.ascontiguousarray(points))
    return float(np.abs(points.compute_implicit_distance(surface.to_pyvista())["implicit_distance"]).mean())


def test_the_mesh_lies_on_the_measured_skin(results):
    """And nowhere near it when it is mirrored, along any axis."""
    skin = results.poses[results.reference_pose].measured_skin
    points = results.mesh.surface("skin").points
    right = away_mm(skin, points)
    assert right < 1.0
    for axis in range(3):
        mirrored = points * np.where(np.arange(3) == axis, -1.0, 1.0)
        assert away_mm(skin, mirrored) > 1.5 * right, f"axis {axis}"


def test_landmarks_lie_on_the_mesh_and_in_the_labels(results, study):
    """Nipples: landmark in the table, label in NIfTI, node of the mesh; breasts differ, so sides count."""
    for name, pose in results.poses.items():
        points = landmarks(study, name)
        skin = pose.measured_skin.points
        for side in ("right", "left"):
            nipple = points[f"nipple_{side}"]
            assert np.linalg.norm(skin - nipple, axis=1).min() < 5.0, f"{name}, {side}"
        if pose.is_reference:
            # The node is the skin farthest from the wall, the landmark where the nipple is.
            nodes = results.mesh.points[results.calibration.nipple_nodes]
            for node, side in zip(nodes, ("right", "left"), strict=True):
                assert np.linalg.norm(node - points[f"nipple_{side}"]) < NIPPLE_MM, f"{side}: {node}"
        image = pose.labels()
        areola = np.argwhere(np.asanyarray(image.dataobj) == Tissue.NIPPLE_AREOLA)
        if len(areola):
            world = nibabel.affines.apply_affine(image.affine, areola)
            for side in ("right", "left"):
                assert np.linalg.norm(world - points[f"nipple_{side}"], axis=1).min() < 15.0


def test_the_motion_of_a_pose_goes_from_its_image_to_the_reference(results, study):
    reference = landmarks(study, results.reference_pose)
    for name, pose in results.poses.items():
        if pose.is_reference:
            continue
        own = landmarks(study, name)
        chest = [key for key in own if key.startswith("chest_") and key in reference]
        there, here = np.array([reference[key] for key in chest]), np.array([own[key] for key in chest])
        rms = lambda motion: np.sqrt(np.mean(np.sum((motion(here) - there) ** 2, axis=1)))  # noqa: E731
        right = rms(pose.to_reference)
        for wrong in (RigidTransform.identity(), pose.to_reference.inverse):
            assert right < rms(wrong), name
        transposed = RigidTransform(pose.to_reference.rotation.T, pose.to_reference.translation_mm)
        assert right < rms(transposed), name
        # The measured skin, brought over, is where the simulation is.
        distances = pose.after.distances
        nodes = pose.state.mesh.points[pose.after.nodes]
        brought = away_mm(pose.measured_skin.moved(pose.to_reference), nodes)
        assert brought == pytest.approx(distances.mean_mm, abs=1e-3)
        assert brought < away_mm(pose.measured_skin, nodes)


def test_the_motion_in_itk(results, tmp_path):
    """SimpleITK resamples a pose's labels onto the reference pose: muscles meet."""
    reference = results.poses[results.reference_pose]
    fixed = sitk.ReadImage(str(reference.labels_file))
    chest = lambda image: sitk.GetArrayFromImage(image) == Tissue.THORAX  # noqa: E731

    def dice(a, b):
        return 2.0 * np.sum(a & b) / (a.sum() + b.sum())

    for name, pose in results.poses.items():
        if pose.is_reference:
            continue
        moving = sitk.ReadImage(str(pose.labels_file))
        path = tmp_path / f"{name}.tfm"
        pose.to_reference.save(path)
        stored = sitk.ReadTransform(str(path))
        point = np.array([30.0, 90.0, -12.0])
        moved = np.array(stored.TransformPoint(tuple(point * TO_LPS))) * TO_LPS
        np.testing.assert_allclose(moved, pose.to_reference.inverse(point), atol=1e-9)
        laid = lambda transform: sitk.Resample(moving, fixed, transform, sitk.sitkNearestNeighbor, 0)  # noqa: B023, E731
        overlap = dice(chest(fixed), chest(laid(stored)))
        assert overlap > 0.9, name
        assert overlap > dice(chest(fixed), chest(laid(stored.GetInverse()))), name


def test_transforms_compose():
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    motion = RigidTransform(axes * np.sign(np.linalg.det(axes)), np.array([3.0, -20.0, 7.0]))
    points = rng.normal(size=(5, 3)) * 50
    np.testing.assert_allclose(motion.then(motion.inverse)(points), points, atol=1e-10)
    homogeneous = np.c_[points, np.ones(5)] @ motion.matrix.T
    np.testing.assert_allclose(homogeneous[:, :3], motion(points), atol=1e-10)
    np.testing.assert_allclose(motion.lps()(points * TO_LPS), motion(points) * TO_LPS, atol=1e-10)
    stored = {"rotation": motion.rotation.tolist(), "translation": motion.translation_mm.tolist()}
    np.testing.assert_array_equal(RigidTransform.from_json(stored).rotation, motion.rotation)
    turned = motion.to_simpleitk().TransformPoint((points[0] * TO_LPS).tolist())
    np.testing.assert_allclose(np.array(turned) * TO_LPS, motion(points[0]), atol=1e-8)


@pytest.mark.parametrize("frame", ["RAS", "LPS"])
def test_pyvista_and_meshio_agree_in_both_frames(results, tmp_path, frame):
    sign = np.ones(3) if frame == "RAS" else TO_LPS
    for name, state in results.states.items():
        mesh = state.mesh
        path = tmp_path / f"{name}.vtu"
        mesh.save(path, frame)
        opened = {"pyvista": pyvista.read(path), "meshio": meshio.read(path), "direct": mesh.to_pyvista(frame)}
        for program, grid in opened.items():
            np.testing.assert_allclose(grid.points, mesh.points * sign, atol=1e-4, err_msg=program)
            here = grid.point_data["displacement_mm"]
            np.testing.assert_allclose(here, (mesh.points - state.rest.points) * sign, atol=1e-9)
            cells = grid.cell_data["cauchy_kpa"]
            cauchy = np.asarray(cells[0] if isinstance(cells, list) else cells).reshape(-1, 3, 3)
            np.testing.assert_allclose(cauchy, mesh.cell_fields["cauchy_kpa"].values * np.outer(sign, sign), atol=1e-9)
            tissue = grid.cell_data["tissue"]
            np.testing.assert_array_equal(np.asarray(tissue[0] if isinstance(tissue, list) else tissue), mesh.tissues)
        volumes = opened["pyvista"].compute_cell_sizes(length=False, area=False)["Volume"]
        np.testing.assert_allclose(volumes, mesh.volumes_mm3, rtol=1e-3, atol=1e-3)


def test_surfaces_face_outward_in_both_frames(results):
    surface = results.mesh.surface()
    for frame in ("RAS", "LPS"):
        opened = surface.to_pyvista(frame)
        assert opened.n_open_edges == 0
        assert opened.volume == pytest.approx(results.mesh.volumes_mm3.sum(), rel=1e-6)
        corners = np.asarray(opened.points)[opened.regular_faces]
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        assert volume > 0, "outward"
    skin = results.mesh.surface("skin").to_meshio()
    assert len(skin.cells[0].data) == len(results.mesh.patches["skin"])


def test_a_turned_mesh_keeps_its_invariants(results):
    motion = results.compression.to_detector
    mesh = results.compression.state.mesh
    turned = mesh.moved(motion)
    np.testing.assert_allclose(turned.volumes_mm3, mesh.volumes_mm3, rtol=1e-9)
    moved = turned.points - results.compression.state.rest.moved(motion).points
    np.testing.assert_allclose(turned.point_fields["displacement_mm"].values, moved, atol=1e-9)
    again = mammotwin.fields.von_mises(turned.cell_fields["cauchy_kpa"].values)
    np.testing.assert_allclose(again, mesh.cell_fields["von_mises_kpa"].values, rtol=1e-7, atol=1e-12)
    # F maps edges of the turned rest shape to edges of the turned shape.
    rest = results.compression.state.rest.moved(motion)
    edges = lambda points: np.swapaxes(points[mesh.tets[:, 1:]] - points[mesh.tets[:, :1]], 1, 2)  # noqa: E731
    gradient = turned.cell_fields["deformation_gradient"].values
    np.testing.assert_allclose(gradient @ edges(rest.points), edges(turned.points), atol=1e-6)


def test_the_compressed_breast_is_on_its_side(results):
    compression = results.compression
    sign = 1 if compression.side == "right" else -1
    assert sign * compression.state.mesh.centers[:, 0].mean() > 30
    tissues = set(np.unique(compression.state.mesh.tissues).tolist())
    assert tissues & set(RIGHT if sign > 0 else LEFT) and not tissues & set(LEFT if sign > 0 else RIGHT)
    # Its picture is where the body between the plates is: x and y of the detector, magnified a little.
    for picture in results.radiographs.values():
        placed = compression.to_detector(compression.state.mesh.points)
        inside = placed[placed[:, 1] > 0.0]
        shadow = picture.pixels < 0.7 * np.quantile(picture.pixels, 0.99)
        columns, rows = picture.x_mm[shadow.any(axis=0)], picture.y_mm[shadow.any(axis=1)]
        assert columns.min() == pytest.approx(inside[:, 0].min(), abs=8.0)
        assert columns.max() == pytest.approx(inside[:, 0].max(), abs=8.0)
        assert rows.max() == pytest.approx(inside[:, 1].max(), abs=6.0)
