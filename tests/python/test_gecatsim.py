"""Projections of a half cylinder and of a large breast beside those of another simulator, gecatsim (XCIST): values and speed.

Skipped without gecatsim, which `scripts/bench` and `scripts/test --full` install. MAMMOTWIN names the program; without it the
one that was built in this repository is taken.
"""

import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

xc = pytest.importorskip("gecatsim", reason="no gecatsim: scripts/bench installs it")

PROGRAM = Path(os.environ.get("MAMMOTWIN") or Path(__file__).resolve().parents[2] / "target/release/mammotwin")
PITCH_MM = float(os.environ.get("MAMMOTWIN_GECATSIM_PIXEL_MM", "0.5"))
KEV = 24

# A whole cylinder: rays to the detector meet the half in front of the chest wall alone. Its axis is y, the beam's.
CYLINDER = """materialList = {'water' };
object.center(1,:) = [0.000000 43.000000 0.000000];
object.half_axes(1,:) = [100.000000 100.000000 23.000000];
object.euler_angs(1,:) = [0.000000 90.000000 0.000000];
object.density(1) = 1.000000;
object.type(1) = 2;
object.material(1) = 1;
object.axial_lims(1,:) = [0 0];
object.shape(1) = 0;
object.clip{1} = [];
"""


def breast(around=360, up=96, extent_mm=(115.0, 120.0), thickness_mm=60.0, bottom_mm=20.0):
    """Corners (triangles x 3 x 3, mm) of a closed breast between plates with a round edge: half an ellipse from above."""
    half = thickness_mm / 2
    profile, turn = np.linspace(-np.pi / 2, np.pi / 2, up + 1), np.linspace(0, np.pi, around + 1)
    out = half * np.cos(profile)[:, None] - half
    x, y = (extent_mm[0] + out) * np.cos(turn), (extent_mm[1] + out) * np.sin(turn)
    y[:, [0, -1]] = 0
    z = np.broadcast_to((bottom_mm + half + half * np.sin(profile))[:, None], x.shape)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    at = np.arange(len(points)).reshape(x.shape)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    first, last, below, above = at[:-1, 0], at[:-1, -1], at[1:, 0], at[1:, -1]
    bottom, top = at[0], at[-1]
    triangles = [(a, b, c), (a, c, d), (last, first, below), (last, below, above)]
    triangles += [(np.full(around - 1, bottom[0]), bottom[2:], bottom[1:-1])]
    triangles += [(np.full(around - 1, top[0]), top[1:-1], top[2:])]
    return points[np.concatenate([np.stack([n.ravel() for n in t], axis=-1) for t in triangles])]


def write_stl(path, corners):
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = corners
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + facets.tobytes())


def write_polygons(path, corners):
    """Material 0 is water; the beam's axis is y."""
    turned = corners[:, :, [0, 2, 1]]
    lines = [" ".join(",".join(f"{x:.6f}" for x in corner) for corner in triangle) for triangle in turned]
    path.write_text("\n".join(["1", "breast", "0", str(len(lines)), *lines]) + "\n")


def timed(module, name, monkeypatch):
    """Seconds that their projector itself takes, appended at each call."""
    projector, seconds = getattr(module, name), []

    def call(*arguments):
        begin = time.perf_counter()
        result = projector(*arguments)
        seconds.append(time.perf_counter() - begin)
        return result

    monkeypatch.setattr(module, name, call)
    return seconds


def project(folder, *arguments):
    """Runs `study projection`; the seconds of the whole program, start and writing included."""
    if not PROGRAM.exists():
        pytest.skip("no program: build it, or set MAMMOTWIN")
    command = [PROGRAM, "study", "projection", "--out", folder, "--pixel-mm", str(PITCH_MM), "--threads", "2", *arguments]
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin


def their_paths(folder, phantom, projector, filename):
    """Path lengths (mm) of one projection and the seconds of the whole scan."""
    from gecatsim.pyfiles.GetMu import GetMu

    columns, rows = round(285 / PITCH_MM), round(239.4 / PITCH_MM)
    scan = xc.CatSim()
    scan.phantom.callback, scan.phantom.projectorCallback = phantom, projector
    scan.phantom.filename, scan.phantom.centerOffset = str(filename), [0.0, 0.0, 0.0]
    scan.phantom.scale, scan.phantom.projectorNumThreads = 1.0, 2
    scanner, physics, protocol = scan.scanner, scan.physics, scan.protocol
    scanner.sid = scanner.sdd = 660.0
    scanner.detectorColsPerMod = scanner.detectorColCount = columns
    scanner.detectorRowsPerMod = scanner.detectorRowCount = rows
    scanner.detectorColSize = scanner.detectorRowSize = PITCH_MM
    scanner.detectorColOffset, scanner.detectorRowOffset = 0.0, rows / 2
    scanner.detectorPrefilter = []
    scanner.focalspotShape, scanner.focalspotWidth, scanner.focalspotLength = "Uniform", 1e-6, 1e-6
    physics.monochromatic, physics.energyCount = KEV, 1
    for name in ("colSample", "rowSample", "srcXSample", "srcYSample", "viewSample"):
        setattr(physics, f"{name}Count", 1)
    physics.enableQuantumNoise = physics.enableElectronicNoise = 0
    protocol.viewsPerRotation = protocol.viewCount = 1
    protocol.stopViewId, protocol.bowtie, protocol.flatFilter, protocol.mA = 0, [], [], 1e6
    scan.resultsName = str(folder / "theirs")
    begin = time.perf_counter()
    scan.run_all()
    seconds = time.perf_counter() - begin
    attenuation = xc.rawread(f"{scan.resultsName}.prep", [1, rows, columns], "float")[0]
    return attenuation / (GetMu("water", KEV)[0] / 10), seconds


def test_a_half_cylinder_is_projected_alike(tmp_path):
    project(tmp_path)
    ours = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "half_cylinder.tiff")))
    (tmp_path / "cylinder.ppm").write_text(CYLINDER)
    theirs, _ = their_paths(tmp_path, "Phantom_Analytic", "C_Projector_Analytic", tmp_path / "cylinder.ppm")
    assert ours.shape == theirs.shape
    interior = theirs > 40
    assert interior.mean() > 0.2
    off = np.abs(ours[interior] / theirs[interior] - 1)
    # Outside of the interior rays leave through the round side wall, whose facets lie 0.2 µm inside.
    edges = np.abs(ours - theirs)[~interior].max()
    print(f"interior {off.max():.1e}, edges {edges:.1e} mm")
    assert off.max() <= 0.005
    assert edges < 0.05


def test_a_large_breast_is_projected_alike_and_ten_times_as_fast(tmp_path, monkeypatch):
    """The same 70 k triangles, two threads each; ours with start and files, theirs the projector alone."""
    import gecatsim.pyfiles.C_Projector_Polygon as module

    corners = breast()
    write_stl(tmp_path / "breast.stl", corners)
    write_polygons(tmp_path / "breast.txt", corners)
    seconds = min(project(tmp_path, "--surface", tmp_path / "breast.stl") for _ in range(3))
    ours = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "surface.tiff")))
    calls = timed(module, "C_Projector_Polygon", monkeypatch)
    theirs, whole = their_paths(tmp_path, "Phantom_Polygonal", "C_Projector_Polygon", tmp_path / "breast.txt")
    assert ours.shape == theirs.shape
    interior = theirs > 50
    assert interior.mean() > 0.1
    off = np.abs(ours[interior] / theirs[interior] - 1)
    others = np.abs(ours - theirs)[~interior]
    print(
        f"interior {off.max():.1e}; others {np.sqrt((others**2).mean()):.1e} mm rms, {others.max():.1e} mm at most; "
        f"{seconds:.2f} s, gecatsim's projector {calls[-1]:.2f} s of {whole:.2f} s"
    )
    assert off.max() <= 0.005
    assert others.max() < 0.05
    assert calls[-1] > 10 * seconds
