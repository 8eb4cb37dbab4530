"""An asymmetric phantom goes through the program in every storage order: nothing is mirrored, shifted or turned.

Her right breast is large and high, her left one small and low, and both are known in closed form in RAS mm.
"""

import json
import subprocess

import h5py
import numpy as np
import pytest

nibabel = pytest.importorskip("nibabel")
sitk = pytest.importorskip("SimpleITK")

VOXEL_MM = 4.0
#: Centre, half axes (mm) of the ellipsoids; the torso is a cylinder along z.
RIGHT = np.array([75.0, 80.0, 20.0]), np.array([60.0, 60.0, 55.0])
LEFT = np.array([-70.0, 80.0, -20.0]), np.array([45.0, 45.0, 40.0])
TORSO = np.array([0.0, 0.0, 0.0]), np.array([150.0, 105.0, 1e9])
APEX = {"right": RIGHT[0] + [0, RIGHT[1][1], 0], "left": LEFT[0] + [0, LEFT[1][1], 0]}
STUDY = """schema = 1
[subject]
id = "phantom"
[poses.supine]
image = "image.nii.gz"
labels = "labels.nii.gz"
posture = "supine"
"""


def level(shape, points):
    """Negative inside; about the distance in mm near the surface."""
    center, axes = shape
    scaled = (points - center) / axes
    length = np.linalg.norm(scaled, axis=-1)
    gradient = np.linalg.norm(scaled / axes, axis=-1) / np.maximum(length, 1e-9)
    return (length - 1.0) / np.maximum(gradient, 1e-9)


def body(points):
    return np.minimum(level(TORSO, points), np.minimum(level(RIGHT, points), level(LEFT, points)))


def tissues(points):
    """Labels at places in RAS mm."""
    muscle = level((TORSO[0], TORSO[1] - [10.0, 10.0, 0.0]), points) < 0
    thorax = level((TORSO[0], TORSO[1] - [22.0, 22.0, 0.0]), points) < 0
    labels = np.zeros(points.shape[:-1], dtype=np.uint8)
    labels[level(TORSO, points) < 0] = 9
    labels[(level(RIGHT, points) < 0) & ~muscle] = 1
    labels[(level(LEFT, points) < 0) & ~muscle] = 2
    labels[muscle] = np.where(points[muscle][:, 1] > 0, 6, 7)
    labels[thorax] = 7
    return labels


def grid(codes, degrees):
    """Shape and affine of a voxel grid that is stored along `codes` and turned about its centre."""
    low, high = np.array([-170.0, -122.0, -110.0]), np.array([170.0, 170.0, 130.0])
    axes = []
    for code in codes:
        axis = "RLAPSI".index(code) // 2
        axes.append(np.eye(3)[axis] * (1.0 if code in "RAS" else -1.0))
    turned = nibabel.eulerangles.euler2mat(*np.radians(degrees)) @ np.array(axes).T
    extent = np.abs(np.array(axes)) @ (high - low)
    shape = np.ceil(extent / VOXEL_MM).astype(int)
    affine = np.eye(4)
    affine[:3, :3] = turned * VOXEL_MM
    affine[:3, 3] = 0.5 * (low + high) - affine[:3, :3] @ (0.5 * (shape - 1))
    return tuple(shape), affine


def store(folder, codes, degrees):
    folder.mkdir()
    shape, affine = grid(codes, degrees)
    voxels = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    labels = tissues(nibabel.affines.apply_affine(affine, voxels))
    nibabel.save(nibabel.Nifti1Image(labels, affine), folder / "labels.nii.gz")
    nibabel.save(nibabel.Nifti1Image((100 * labels).astype(np.int16), affine), folder / "image.nii.gz")
    (folder / "study.toml").write_text(STUDY)
    return affine


def run(program, *words):
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(
    scope="module", params=[("RAS", (0, 0, 0)), ("LPI", (0, 0, 0)), ("SAL", (0, 0, 0)), ("LAS", (9, -6, 12))]
)
def phantom(request, program, tmp_path_factory):
    """Folder of a study whose surfaces are made, and the affine of its image."""
    codes, degrees = request.param
    folder = tmp_path_factory.mktemp("phantom") / codes
    affine = store(folder, codes, degrees)
    assert "".join(nibabel.aff2axcodes(affine)) == codes
    run(program, "run", folder / "study.toml", "--until", "surface")
    return folder, affine


def test_the_header_is_read_as_nibabel_reads_it(program, phantom):
    folder, affine = phantom
    facts = json.loads(run(program, "inspect", "--json", folder / "labels.nii.gz"))
    np.testing.assert_allclose(facts["affine"], affine, atol=1e-4)


def test_surfaces_lie_where_the_phantom_is(phantom):
    folder, _ = phantom
    (path,) = folder.glob("out/cache/surface/supine-*/result.h5")
    with h5py.File(path) as file:
        points, triangles = file["skin/points"][()], file["skin/triangles"][()]
    # The image cuts the torso at its lower and upper end, turned with the grid.
    on_the_side = np.abs(points[:, 2] - 10.0) < 80.0
    away = np.abs(body(points[on_the_side]))
    assert np.quantile(away, 0.99) < VOXEL_MM and away.mean() < 0.25 * VOXEL_MM
    for side, sign in (("right", 1), ("left", -1)):
        half = points[(sign * points[:, 0] > 20.0) & on_the_side]
        front = half[np.argmax(half[:, 1])]
        assert np.linalg.norm(front - APEX[side]) < 3.0 * VOXEL_MM, f"{side}: {front}"
        assert front[1] == pytest.approx(APEX[side][1], abs=VOXEL_MM)
    a, b, c = (points[triangles[:, n]] for n in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0, "outward"
    # Mirrored along any axis it would be wrong.
    for axis in (0, 1, 2):
        mirrored = points[on_the_side] * np.where(np.arange(3) == axis, -1.0, 1.0)
        assert np.quantile(np.abs(body(mirrored)), 0.99) > 2 * VOXEL_MM


def test_itk_finds_the_breasts_in_lps(phantom):
    folder, _ = phantom
    image = sitk.ReadImage(str(folder / "labels.nii.gz"))
    for label, (center, _) in ((1, RIGHT), (2, LEFT)):
        x, y, z = (float(v) for v in center + [0.0, 35.0, 0.0])
        index = image.TransformPhysicalPointToIndex((-x, -y, z))
        assert image[index] == label


def test_landmarks_of_all_formats_are_ras(program, tmp_path):
    point = np.array([80.5, -12.25, 33.0])
    x, y, z = point
    (tmp_path / "a.csv").write_text(f"name,x_mm,y_mm,z_mm\nnipple_right,{x},{y},{z}\n")
    for system, (sx, sy, sz) in (("RAS", (x, y, z)), ("LPS", (-x, -y, z))):
        (tmp_path / f"{system}.fcsv").write_text(
            f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n"
            f"# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
            f"1,{sx},{sy},{sz},0,0,0,1,1,1,0,nipple_right,,\n"
        )
        control = [{"label": "nipple_right", "position": [sx, sy, sz]}]
        markups = {"markups": [{"type": "Fiducial", "coordinateSystem": system, "controlPoints": control}]}
        (tmp_path / f"{system}.mrk.json").write_text(json.dumps(markups))
    files = sorted(tmp_path.iterdir())
    assert len(files) == 5
    for file in files:
        facts = json.loads(run(program, "inspect", "--json", file))
        np.testing.assert_allclose(facts["landmarks_mm"]["nipple_right"], point, err_msg=file.name)


def test_labels_that_the_program_writes_lie_on_their_image(program, study, tmp_path):
    """A scan that is stored left-posterior-inferior gives the labels of the same scan stored as it was."""
    scan = nibabel.load(study / "supine.nii.gz")
    turn = nibabel.orientations.ornt_transform(
        nibabel.io_orientation(scan.affine), nibabel.orientations.axcodes2ornt("LPI")
    )
    nibabel.save(scan.as_reoriented(turn), tmp_path / "image.nii.gz")
    (tmp_path / "study.toml").write_text(STUDY.replace('labels = "labels.nii.gz"\n', ""))
    run(program, "run", tmp_path / "study.toml", "--until", "segment")
    there = nibabel.as_closest_canonical(nibabel.load(tmp_path / "out/labels/supine.nii.gz"))
    here = nibabel.as_closest_canonical(nibabel.load(study / "out/labels/supine.nii.gz"))
    np.testing.assert_allclose(there.affine, here.affine, atol=1e-4)
    same = np.asanyarray(there.dataobj) == np.asanyarray(here.dataobj)
    assert same.mean() > 0.999
