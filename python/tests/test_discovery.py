"""What `discover` found, read and drawn; MAMMOTWIN_DISCOVERY names a discovery.h5."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

import mammotwin
from mammotwin import plots

VERDICTS = {"no_discrepancy", "named", "ambiguous", "unknown", "insufficient_data", "measurement_artifact"}


@pytest.fixture(scope="module")
def found():
    name = os.environ.get("MAMMOTWIN_DISCOVERY")
    if not name:
        pytest.skip("no discovery: set MAMMOTWIN_DISCOVERY")
    with mammotwin.open_discovery(Path(name)) as found:
        yield found


def test_the_verdict_follows_from_its_numbers(found):
    assert found.verdict in VERDICTS
    assert found.reason
    best = found.scores[0]
    if found.verdict == "named":
        assert best.z > found.limit
        assert found.candidates[0].effect == found.effect
        assert found.candidates[0].held_out_z >= 2.0
    if found.verdict == "no_discrepancy":
        assert found.effect is None
        gain = max(candidate.gain for candidate in found.candidates)
        assert best.z <= found.limit or gain < found.limit**2


def test_scores_are_of_the_library_and_testable_ones_have_an_amplitude(found):
    names, cosines = found.cosines
    assert sorted(score.effect for score in found.scores) == sorted(names)
    assert cosines.shape == (len(names), len(names))
    for score in found.scores:
        assert score.testable == (score.amplitude is not None) == (score.detectable_z > found.limit)
        assert 0.0 <= score.surviving <= 1.0 + 1e-9
        if score.testable:
            at = names.index(score.effect)
            assert cosines[at, at] == pytest.approx(1.0, abs=1e-6)
    assert set(found.not_testable) == {score.effect for score in found.scores if not score.testable}


def test_root_mean_squares_are_those_of_the_distances_without_a_rigid_motion(found):
    """Written a second time: least squares on small translations and rotations of the skin."""
    for gap in found.gaps.values():
        skin = gap.before
        compared = np.isfinite(skin.point_fields["signed_distance_mm"].values)
        corners = skin.points[skin.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros_like(skin.points)
        for corner in range(3):
            np.add.at(normals, skin.triangles[:, corner], across)
        normals = normals[compared]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = skin.points[compared] - skin.points[compared].mean(axis=0)
        modes = np.hstack([normals, np.cross(points, normals)])
        values = skin.point_fields["signed_distance_mm"].values[compared]
        left = values - modes @ np.linalg.lstsq(modes, values, rcond=None)[0]
        # Normals at a vertex may be weighed by area or by angle.
        assert np.sqrt(np.mean(left**2)) == pytest.approx(gap.rms_before_mm, rel=0.05)
        assert gap.floor_mm > 0.0


def test_nothing_is_named_where_nothing_is_hidden(found):
    if not os.environ.get("MAMMOTWIN_NOTHING_HIDDEN"):
        pytest.skip("set MAMMOTWIN_NOTHING_HIDDEN for a volunteer who hides nothing")
    assert found.verdict not in {"named", "ambiguous"}, found.reason


def test_moduli_pose_by_pose_are_near_the_fitted_ones(found):
    seen = {pose.pose for pose in found.pose_moduli}
    assert seen < set(found.gaps) and len(seen) == len(found.gaps) - 1
    for pose in found.pose_moduli:
        assert pose.right_kpa > 0.0 and pose.right_log_error > 0.0
    if found.second is not None:
        assert found.second.effect != found.candidates[0].effect
        assert found.second.z > found.second.limit


def test_gaps_are_drawn(found):
    pytest.importorskip("matplotlib").use("Agg")
    for gap in found.gaps.values():
        axes = plots.gap_map(gap, "before")
        assert gap.pose in axes.get_title()
        # The map is painted, not grey all over: most compared nodes are corners of triangles that are compared.
        skin = gap.before
        values = skin.point_fields["signed_distance_mm"].values
        painted = np.unique(skin.triangles[np.isfinite(values[skin.triangles]).all(axis=1)])
        assert len(painted) > 0.8 * np.isfinite(values).sum()
    assert len(plots.scores(found).patches) == len(found.scores)
    with pytest.raises(ValueError, match="before"):
        plots.gap_map(gap, "later")


def test_other_files_are_refused(tmp_path):
    with pytest.raises(mammotwin.MissingError, match="mammotwin discover"):
        mammotwin.open_discovery(tmp_path)
    with h5py.File(tmp_path / "discovery.h5", "w") as other:
        other["x"] = 1
    with pytest.raises(mammotwin.NotResultsError, match="no discovery.h5"):
        mammotwin.open_discovery(tmp_path)
