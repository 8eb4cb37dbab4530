"""Pictures show what they say, the right way round."""

import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from mammotwin import plots  # noqa: E402


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def drawn(ax):
    """Draws, so that errors of the backend show, and gives the axes back."""
    ax.figure.canvas.draw()
    return ax


def test_curves(results):
    ax = drawn(plots.force_curve(results.compression))
    paddle, receptor = (line.get_ydata() for line in ax.get_lines())
    np.testing.assert_array_equal(paddle, results.compression.curve["force_n"])
    np.testing.assert_array_equal(receptor, results.compression.curve["receptor_force_n"])
    assert ax.xaxis_inverted() and "(N)" in ax.get_ylabel() and "(mm)" in ax.get_xlabel()
    assert "(kPa)" in drawn(plots.pressure_curve(results.compression)).get_ylabel()
    assert "kPa" in drawn(plots.calibration(results.calibration)).get_ylabel()


def test_distances_are_seen_from_the_front(results):
    pose = next(p for p in results.poses.values() if not p.is_reference)
    ax = drawn(plots.distance_map(pose.after))
    assert ax.xaxis_inverted(), "her right is on the left"
    (faces,) = ax.collections
    values = faces.get_array()
    assert values.mask.any() and not values.mask.all(), "some skin is not compared"
    assert faces.get_clim() == pytest.approx((-np.abs(pose.after.signed_mm).max(), np.abs(pose.after.signed_mm).max()))


def test_pressure(results):
    compression = results.compression
    for side in ("paddle", "receptor"):
        ax = drawn(plots.pressure_map(compression, side))
        assert ax.xaxis_inverted() == (side == "receptor")
        shown = ax.collections[0].get_array()
        assert 0.0 < shown.max() <= compression.contact_pressure.values.max()


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mammogram_hangs_with_lateral_up(results, side):
    picture = next(iter(results.radiographs.values()))
    ax = drawn(plots.mammogram(picture, side))
    # The chest wall (0) is on the right of a right breast's picture, on the left of a left one's.
    assert ax.xaxis_inverted() == (side == "right")
    # Lateral is +x of the right breast, -x of the left one.
    assert ax.yaxis_inverted() == (side == "left")
    assert len(ax.patches) == len(picture.regions)
    # Tissue is light where the pixels have little signal.
    image = np.asarray(ax.images[0].get_array())
    x, y = picture.regions[0].center_mm
    row, column = np.abs(picture.x_mm - x).argmin() // 4, np.abs(picture.y_mm - y).argmin() // 4
    assert image[row, column] > 0.5 * image.max()
    assert image[row, -1] < 0.2 * image.max(), "air is dark"
