"""Other programs read the pictures and the phantom beside `results.h5`: pydicom, dciodvfy, tiff readers, SimpleITK, nibabel.

The results are named by the environment variable MAMMOTWIN_RESULTS; without it the tests are skipped.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import nibabel
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk

PATH = os.environ.get("MAMMOTWIN_RESULTS")
pytestmark = pytest.mark.skipif(not PATH, reason="no results: set MAMMOTWIN_RESULTS")


@pytest.fixture(scope="module")
def images():
    folder = Path(PATH).parent / "images"
    if not list(folder.glob("*.dcm")):
        pytest.skip("no mammogram in these results")
    return folder


def read(images, ending):
    return [(path, pydicom.dcmread(path)) for path in sorted(images.glob(f"*_{ending}.dcm"))]


def test_pydicom_reads_the_signal_that_the_float_picture_has(images):
    found = read(images, "for_processing")
    assert found
    for path, file in found:
        assert file.SOPClassUID.name == "Digital Mammography X-Ray Image Storage - For Processing"
        assert file.SOPInstanceUID == file.file_meta.MediaStorageSOPInstanceUID
        raw = sitk.GetArrayFromImage(sitk.ReadImage(str(path).replace("_for_processing.dcm", ".tiff")))
        # Rows of the raw picture begin at the chest wall; a mammogram is hung with it at one side.
        hung = raw.T if file.ImageLaterality == "L" else raw.T[::-1, ::-1]
        gain = float(file.ImageComments.split("=")[1].split("x")[0])
        assert file.pixel_array.shape == hung.shape
        assert np.abs(file.pixel_array - hung * gain).max() <= 0.5
        assert [float(mm) for mm in file.ImagerPixelSpacing] == [file.ImagerPixelSpacing[0]] * 2
        # An organ dose is in dGy.
        assert 0.3 < float(file.OrganDose) * 100 < 10


def test_dense_is_bright_in_what_is_shown(images):
    for (_, shown), (_, raw) in zip(read(images, "for_presentation"), read(images, "for_processing"), strict=True):
        assert shown.PhotometricInterpretation == "MONOCHROME2"
        assert shown.StudyInstanceUID == raw.StudyInstanceUID
        assert shown.SOPInstanceUID != raw.SOPInstanceUID
        faint, bright = raw.pixel_array.astype(float), shown.pixel_array.astype(float)
        assert np.corrcoef(np.log(faint[faint > 100]), bright[faint > 100])[0, 1] < -0.999
        low, high = shown.WindowCenter - shown.WindowWidth / 2, shown.WindowCenter + shown.WindowWidth / 2
        assert ((bright > low) & (bright < high)).mean() > 0.005


def test_dciodvfy_finds_no_error(images):
    program = shutil.which("dciodvfy")
    if not program:
        pytest.skip("no dciodvfy: install dicom3tools")
    for path in sorted(images.glob("*.dcm")):
        said = subprocess.run([program, path], capture_output=True, text=True, check=False)
        errors = [line for line in (said.stdout + said.stderr).splitlines() if line.startswith("Error")]
        assert not errors, (path.name, errors)


def test_the_phantom_is_the_same_in_both_formats_and_its_grains_lie_in_tissue(images):
    legend = json.loads((images / "phantom.json").read_text())
    nifti = nibabel.load(images / "phantom.nii.gz")
    labels = np.asarray(nifti.dataobj)
    one, other = (sitk.ReadImage(str(images / f"phantom.{ending}")) for ending in ("nii.gz", "mha"))
    assert np.array_equal(sitk.GetArrayFromImage(one), sitk.GetArrayFromImage(other))
    for name in ("GetOrigin", "GetDirection", "GetSpacing"):
        assert np.allclose(getattr(one, name)(), getattr(other, name)(), atol=1e-5), name
    assert set(np.unique(labels)) == {entry["label"] for entry in legend["labels"]} == {0, 1, 2}
    assert (labels[[0, -1]] == 0).all() and (labels[..., [0, -1]] == 0).all()
    sites = np.array([site["center_mm"] for site in legend["microcalcifications"]["sites"]])
    voxels = np.rint(nibabel.affines.apply_affine(np.linalg.inv(nifti.affine), sites)).astype(int)
    # Below the skin; the voxel about one that is just below may have its own middle in it.
    assert len(voxels) and (labels[tuple(voxels.T)] > 0).all()
    around = [labels[tuple(slice(n - 1, n + 2) for n in voxel)] for voxel in voxels]
    assert all((near == 2).any() for near in around)
    # Between the plates the breast is as thick as they are apart.
    column = labels[voxels[0][0], voxels[0][1]] > 0
    assert abs(column.sum() * nifti.header.get_zooms()[2] - legend["thickness_mm"]) < 0.15 * legend["thickness_mm"]
