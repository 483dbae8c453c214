"""Disparity on slanted planes that are known everywhere, and on Middlebury's motorcycle."""

import cv2
import numpy as np
import pytest

from vo.config import StereoSettings
from vo.contract.sequence import StereoFrame
from vo.stereo import DenseStereo, disparity_at, disparity_slopes

WIDTH, HEIGHT = 400, 240
SETTINGS = StereoSettings()


class Plane:
    """Disparity c + a u + b v under a texture of waves of 5 to 25 px, seen by both eyes."""

    def __init__(self, c, a, b, seed=0, waves=40):
        rng = np.random.default_rng(seed)
        angle, length_px = rng.uniform(0, 2 * np.pi, waves), rng.uniform(5, 25, waves)
        self._k = 2 * np.pi / length_px * np.stack([np.cos(angle), np.sin(angle)])
        self._phase = rng.uniform(0, 2 * np.pi, waves)
        self.slopes = np.array([a, b])
        self.offset = c
        u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        # u_right = u - c - a u - b v, solved for the u of the left eye
        self.frame = StereoFrame(0, self._grey(u, v), self._grey((u + c + b * v) / (1 - a), v))

    def _grey(self, u, v):
        waves = np.cos(np.stack([u, v], axis=-1) @ self._k + self._phase).sum(axis=-1)
        return np.round(128 + 7 * waves).clip(0, 255).astype(np.uint8)

    def disparity_px(self, pixels):
        return self.offset + pixels @ self.slopes


PLANES = {
    "facing": (40.3, 0.0, 0.0),
    "floor": (12.0, 0.0, 0.25),
    "wall": (25.0, 0.12, 0.0),
    "other wall": (70.6, -0.1, -0.08),
}


@pytest.fixture(scope="module", params=PLANES.values(), ids=PLANES)
def plane(request):
    return Plane(*request.param)


@pytest.fixture(scope="module")
def pixels():
    """Sub-pixel places, far enough from the left edge for the right eye to see them too."""
    return np.random.default_rng(0).uniform([130, 25], [WIDTH - 26, HEIGHT - 26], (300, 2))


def dense_of(frame, settings=SETTINGS):
    return DenseStereo(settings)(frame.left, frame.right)


@pytest.mark.parametrize("method", ["semi_global", "block_matching"])
@pytest.mark.parametrize("shrink", [1, 2])
def test_dense_disparity(plane, method, shrink):
    settings = StereoSettings(method=method, shrink=shrink)
    dense = dense_of(plane.frame, settings)
    assert dense.shape == (HEIGHT // shrink, WIDTH // shrink)
    rows, columns = np.nonzero(~np.isnan(dense))
    places = (np.column_stack([columns, rows]) + 0.5) * shrink - 0.5
    error = dense[rows, columns] - plane.disparity_px(places)
    right_of_blind = places[:, 0] > 130
    assert right_of_blind.sum() > 0.5 * dense[:, 130 // shrink :].size
    assert 0 < np.median(np.abs(error[right_of_blind])) < 0.4
    assert (np.abs(error[right_of_blind]) < 2).mean() > 0.97


def test_disparity_at_features_is_sub_pixel(plane, pixels):
    """Against 0.06 px and more of the dense map alone."""
    found = disparity_at(plane.frame, dense_of(plane.frame), pixels, SETTINGS)
    error = np.abs(found - plane.disparity_px(pixels))
    known = ~np.isnan(found)
    assert known.mean() > 0.9
    assert 1e-4 < np.median(error[known]) < 0.05
    assert np.quantile(error[known], 0.99) < 0.3


def test_slopes(plane, pixels):
    dense = dense_of(plane.frame)
    slopes = disparity_slopes(dense, pixels, plane.frame.left.shape)
    assert slopes.shape == (300, 2)
    assert np.abs(np.median(slopes, axis=0) - plane.slopes).max() < 0.02
    assert np.median(np.abs(slopes - plane.slopes)) < 0.03


@pytest.mark.parametrize("shrink", [1, 2, 4])
def test_slopes_of_an_exact_map(shrink):
    """Per pixel of the full image, whatever the size of the map."""
    a, b = 0.1, -0.05
    rows, columns = np.mgrid[: HEIGHT // shrink, : WIDTH // shrink] * float(shrink)
    exact = (30 + a * columns + b * rows).astype(np.float32)
    slopes = disparity_slopes(exact, np.array([[200.0, 100.0]]), (HEIGHT, WIDTH))
    np.testing.assert_allclose(slopes, [[a, b]], atol=1e-5)


def test_no_slope_where_there_is_no_plane():
    dense = np.full((HEIGHT, WIDTH), 20.0, np.float32)
    dense[:, WIDTH // 2 :] = 40.0
    unknown = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    places = np.array([[WIDTH / 2, 100.0], [-20.0, 50.0], [1e4, 50.0], [np.nan, np.nan], [0, 0]])
    for values in (dense, unknown):
        assert not disparity_slopes(values, places, (HEIGHT, WIDTH)).any()


def test_unknown_outside_and_in_front_of_what_is_seen(plane):
    dense = dense_of(plane.frame)
    places = [[-5, 50], [WIDTH + 5, 50], [200, -5], [200, HEIGHT + 5], [np.nan, 50], [2, 2]]
    assert np.isnan(disparity_at(plane.frame, dense, np.array(places, float), SETTINGS)).all()
    nothing = np.full_like(dense, np.nan)
    inside = np.array([[200.0, 100.0]])
    assert np.isnan(disparity_at(plane.frame, nothing, inside, SETTINGS)).all()
    assert disparity_at(plane.frame, dense, np.zeros((0, 2)), SETTINGS).shape == (0,)


@pytest.mark.parametrize("shrink", [1, 2, 4])
def test_the_dense_map_is_read_where_the_pixel_is(shrink):
    """All of it unknown but the one cell that covers the pixel."""
    plane, pixel = Plane(40.3, 0.0, 0.0), np.array([[203.4, 101.6]])
    shape = (HEIGHT // shrink, WIDTH // shrink)
    row, column = 102 // shrink, 203 // shrink  # the pixel that the place rounds to
    for moved in (0, -1, 1):
        for axis in (0, 1):
            dense = np.full(shape, np.nan, np.float32)
            dense[row + moved * (axis == 0), column + moved * (axis == 1)] = 40
            found = disparity_at(plane.frame, dense, pixel, SETTINGS)
            assert np.isnan(found[0]) == (moved != 0)


def test_depth_gate():
    plane = Plane(4.0, 0.04, 0.0)  # 8 px at u = 100, 18 px at u = 350
    dense = dense_of(plane.frame)
    u = np.linspace(50, 370, 60)
    places = np.column_stack([u, np.full(60, 120.0)])
    gate_px = 12.0
    gated = disparity_at(
        plane.frame, dense, places, SETTINGS.model_copy(update={"least_disparity_px": gate_px})
    )
    truth = plane.disparity_px(places)
    assert np.isnan(gated[truth < gate_px - 0.2]).all()
    assert (~np.isnan(gated[truth > gate_px + 0.2])).mean() > 0.9


def test_a_wrong_start_is_not_believed(plane, pixels):
    """The dense map is wrong by 5 px everywhere: alignment finds the truth in almost no case."""
    wrong = dense_of(plane.frame) + 5
    found = disparity_at(plane.frame, wrong, pixels, SETTINGS)
    assert np.isnan(found).mean() > 0.8


def test_too_small_or_blank_a_pair_has_no_depth():
    tiny = np.zeros((20, 30), np.uint8)
    assert np.isnan(DenseStereo(SETTINGS)(tiny, tiny)).all()
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert np.isnan(DenseStereo(SETTINGS)(blank, blank)).mean() > 0.99


def test_same_pair_same_disparity(plane, pixels):
    a, b = (disparity_at(plane.frame, dense_of(plane.frame), pixels, SETTINGS) for _ in range(2))
    np.testing.assert_array_equal(a, b)


@pytest.fixture(scope="module")
def motorcycle(real_data):
    """The pair with the right image moved by 31 of the 31.086 px of doffs, and its truth.

    Moving the right image's content to the left by k adds k to every disparity; with all of
    doffs, disparity would be f b / Z, and 0.086 px of it stay with the principal point.
    """
    folder, whole_px = real_data("motorcycle"), 31
    left, right = (cv2.imread(str(folder / f"motorcycle_{x}.png"), 0) for x in ("left", "right"))
    moved = np.zeros_like(right)
    moved[:, :-whole_px] = right[:, whole_px:]
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"] + whole_px
    return StereoFrame(0, left, moved), np.where(np.isfinite(truth), truth, np.nan)


@pytest.mark.parametrize(
    ("method", "least_known", "least_good"),
    [("semi_global", 0.6, 0.85), ("block_matching", 0.4, 0.8)],
)
def test_motorcycle(motorcycle, method, least_known, least_good):
    frame, truth = motorcycle
    settings = SETTINGS.model_copy(update={"method": method})
    rows, columns = np.nonzero(~np.isnan(truth))
    chosen = np.random.default_rng(0).choice(len(rows), 4000, replace=False)
    pixels = np.column_stack([columns, rows])[chosen].astype(float)
    true_px = truth[rows, columns][chosen]
    found = disparity_at(frame, dense_of(frame, settings), pixels, settings)
    known = ~np.isnan(found)
    error = np.abs(found - true_px)[known]
    figures = f"known {known.mean():.3f}, within 1 px {(error < 1).mean():.3f} of those"
    assert least_known < known.mean() < 0.99, figures
    assert least_good < (error < 1).mean() < 0.999, figures
    assert 0.01 < np.median(error) < 0.3, figures
