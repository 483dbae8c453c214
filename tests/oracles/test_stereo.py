"""Disparity on slanted planes that are known everywhere, and on Middlebury's motorcycle."""

import cv2
import numpy as np
import pytest

from vo.config import FeatureSettings, StereoSettings
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.detector import detect
from vo.patches.templates import extract_templates
from vo.stereo.dense import DenseStereo
from vo.stereo.epipolar_search import search_epipolar
from vo.stereo.plane_fit import fit_plane_slopes
from vo.stereo.right_camera import MisalignedFrame, RightCamera, StereoErrors
from vo.stereo.slant import fit_patch_slopes
from vo.stereo.sparse import measure_disparities

WIDTH, HEIGHT = 400, 240
SETTINGS = StereoSettings()


class Plane:
    """Disparity c + a u + b v under a texture of waves of 5 to 25 px, seen by both cameras."""

    def __init__(self, c, a, b, seed=0, waves=40):
        rng = np.random.default_rng(seed)
        angle, length_px = rng.uniform(0, 2 * np.pi, waves), rng.uniform(5, 25, waves)
        self._k = 2 * np.pi / length_px * np.stack([np.cos(angle), np.sin(angle)])
        self._phase = rng.uniform(0, 2 * np.pi, waves)
        self.slopes = np.array([a, b])
        self.offset = c
        u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        # u_right = u - c - a u - b v, solved for the u of the left camera
        self.frame = StereoFrame(0, self._grey(u, v), self._grey((u + c + b * v) / (1 - a), v))

    def wave(self, u, v):
        return np.cos(np.stack([u, v], axis=-1) @ self._k + self._phase).sum(axis=-1)

    def _grey(self, u, v):
        return np.round(128 + 7 * self.wave(u, v)).clip(0, 255).astype(np.uint8)

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
    """Sub-pixel places, far enough from the left edge for the right camera to see them too."""
    return np.random.default_rng(0).uniform([130, 25], [WIDTH - 26, HEIGHT - 26], (300, 2))


def dense_of(frame, settings):
    return DenseStereo(settings)(frame.left, frame.right)


def measure(frame, pixels, settings=SETTINGS, **known):
    return measure_disparities(frame, dense_of(frame, settings), pixels, settings, **known)


@pytest.mark.parametrize("method", ["semi_global", "block_matching"])
@pytest.mark.parametrize("downscale", [1, 2])
def test_dense_disparity_on_planes_is_close(plane, method, downscale):
    settings = StereoSettings(method=method, downscale=downscale)
    dense = dense_of(plane.frame, settings)
    assert dense.shape == (HEIGHT // downscale, WIDTH // downscale)
    rows, columns = np.nonzero(~np.isnan(dense))
    places = (np.column_stack([columns, rows]) + 0.5) * downscale - 0.5
    error = dense[rows, columns] - plane.disparity_px(places)
    right_of_overlap = places[:, 0] > 130
    assert right_of_overlap.sum() > 0.5 * dense[:, 130 // downscale :].size
    assert 0 < np.median(np.abs(error[right_of_overlap])) < 0.4
    assert (np.abs(error[right_of_overlap]) < 2).mean() > 0.97


@pytest.fixture(params=["sparse", "semi_global", "block_matching"])
def method(request):
    return request.param


def test_disparities_on_planes_are_sub_pixel(plane, pixels, method):
    """Against 0.06 px and more of the dense maps alone; the uncertainty is that of rounding."""
    found = measure(plane.frame, pixels, StereoSettings(method=method))
    error = np.abs(found.values_px - plane.disparity_px(pixels))
    assert found.known.mean() > 0.9
    assert 1e-4 < np.median(error[found.known]) < 0.03
    assert np.quantile(error[found.known], 0.99) < 0.3
    assert (error[found.known] < 4 * found.sigma_px[found.known] + 0.02).mean() > 0.97
    assert np.array_equal(np.isnan(found.sigma_px), ~found.known)


def test_slopes_on_planes_come_from_neighbours(plane, pixels):
    found = measure(plane.frame, pixels)
    error = np.abs(found.slopes - plane.slopes)[found.known]
    assert 0 < np.median(error) < 0.003
    assert np.quantile(error, 0.95) < 0.02


def test_disparity_is_searched_where_expected(plane, pixels):
    """It is found where it is expected, and nowhere else."""
    alone, truth = pixels[:1], plane.disparity_px(pixels[:1])
    slopes = plane.slopes[None]
    for expected_px, known in ((truth + 2, True), (truth + 9, False), (truth * np.nan, True)):
        found = measure(plane.frame, alone, slopes=slopes, expected_px=expected_px)
        assert found.known[0] == known
        assert not np.abs(found.values_px - truth)[0] > 0.05


def test_slope_of_lone_feature_comes_from_patch(plane, pixels):
    """Without neighbours, from its patch; with them, more exactly."""
    error = {"alone": [], "helped": []}
    others = np.column_stack([pixels[60:], plane.disparity_px(pixels[60:])])
    for pixel in pixels[:60]:
        for name, nearby in (("alone", None), ("helped", others)):
            found = measure(plane.frame, pixel[None], nearby=nearby)
            error[name].append(np.abs(found.slopes[0] - plane.slopes).max())
    assert 0 < np.median(error["alone"]) < 0.02
    assert np.median(error["helped"]) < 0.2 * np.median(error["alone"])


def test_patch_slopes_on_planes_are_close(plane, pixels):
    right = pixels - np.column_stack([plane.disparity_px(pixels), np.zeros(len(pixels))])
    slopes = fit_patch_slopes(
        extract_templates(plane.frame.left, pixels, 17),
        plane.frame.right,
        right + np.array([0.7, 0]),
    )
    assert np.isfinite(slopes).all(axis=1).mean() > 0.9
    assert np.nanmedian(np.abs(slopes - plane.slopes)) < 0.005
    assert np.abs(np.nanmedian(slopes, axis=0) - plane.slopes).max() < 0.003
    nowhere = np.array([[200.0, 5.0], [np.nan, 50.0], [5.0, 50.0]])
    templates = extract_templates(plane.frame.left, np.full((3, 2), 100.0), 17)
    assert np.isnan(fit_patch_slopes(templates, plane.frame.right, nowhere)).all()


def test_plane_slopes_of_exact_planes():
    """The plane on which the feature itself lies, of two; none where there are too few points."""
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 100, (60, 2))
    left = places[:, 0] < 50
    a, b = np.array([0.1, -0.05]), np.array([-0.2, 0.15])
    disparity_px = np.where(left, 30 + places @ a, 75 + places @ b)
    at = np.array([[40.0, 50.0], [60.0, 50.0]])
    own = np.array([30 + at[0] @ a, 75 + at[1] @ b])
    slopes = fit_plane_slopes(at, own, places, disparity_px)
    np.testing.assert_allclose(slopes, [a, b], atol=2e-3)
    alone = fit_plane_slopes(at, np.full(2, np.nan), places[left], disparity_px[left])
    np.testing.assert_allclose(alone, [a, a], atol=2e-3)
    few = np.where(np.arange(60) < 3, disparity_px, np.nan)
    assert not fit_plane_slopes(at, own, places, few).any()
    assert not fit_plane_slopes(at, own, places, rng.uniform(0, 90, 60)).any()
    line = np.column_stack([np.arange(30.0), np.full(30, 50.0)])
    along = fit_plane_slopes(at[:1], own[:1], line, 30 + line @ a)
    np.testing.assert_allclose(along, [[0.1, 0.0]], atol=2e-3)


def test_epipolar_search_equals_opencv(plane):
    """Whole disparities and correlations against OpenCV's template matching."""
    left, right = plane.frame.left, plane.frame.right
    rng, r = np.random.default_rng(0), 5
    places = rng.integers([130, 20], [WIDTH - 20, HEIGHT - 20], (50, 2))
    nearest, farthest = np.full(50, 90.0), np.full(50, 3.0)
    found, zncc, second = search_epipolar(
        left, right, places.astype(float), nearest, farthest, 2 * r + 1
    )
    assert np.isfinite(found).mean() > 0.8
    for (u, v), disparity, score, other in zip(places, found, zncc, second, strict=True):
        if np.isnan(disparity):
            continue
        strip = right[v - r : v + r + 1, max(u - 90 - r, 0) : u - 3 + r + 1]
        patch = left[v - r : v + r + 1, u - r : u + r + 1]
        scores = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)[0]
        best = int(np.argmax(scores))
        assert disparity == u - r - max(u - 90 - r, 0) - best
        assert score == pytest.approx(scores[best], abs=1e-4)
        rest = np.delete(scores, range(max(best - 2, 0), min(best + 3, len(scores))))
        assert other == pytest.approx(rest.max(), abs=1e-4)


def test_disparity_is_found_where_the_right_camera_is_lower(plane):
    """The right image lies 1.5 px lower and 3 px further left than that of a rectified pair."""
    move = np.float32([[1, 0, -3], [0, 1, 1.5]])
    lower = cv2.warpAffine(plane.frame.right, move, (WIDTH, HEIGHT))
    rig = StereoRig(WIDTH, HEIGHT, 4000.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, 0.1)
    turned = np.array([0, 0, 0, 0, 3 / 4000, 0])  # a small yaw in the time of the delay
    right = RightCamera(StereoErrors(row_px=1.5, delay_s=1.0), rig, turned)
    frame = MisalignedFrame(0, plane.frame.left, lower, right_camera=right)
    places = np.random.default_rng(0).uniform([130, 20], [WIDTH - 20, HEIGHT - 20], (60, 2))
    found = measure_disparities(frame, np.zeros((0, 0)), places, SETTINGS)
    assert found.known.mean() > 0.8
    error_px = (found.values_px - plane.disparity_px(places))[found.known]
    assert np.median(np.abs(error_px)) < 0.05


def test_disparity_of_occluded_pixels_is_unknown():
    """A near strip hides a part of the wall from the right camera, and straddles windows."""
    wall, strip = Plane(12.0, 0.0, 0.0, seed=1), Plane(40.0, 0.0, 0.0, seed=2)
    left, right = wall.frame.left.copy(), wall.frame.right.copy()
    left[:, 200:260] = strip.frame.left[:, 200:260]
    right[:, 160:220] = strip.frame.right[:, 160:220]
    frame = StereoFrame(0, left, right)
    u = np.arange(110.0, 350.0)
    places = np.column_stack([u, np.full(len(u), 120.0)])
    found = measure(frame, places)
    truth = np.where((u >= 200) & (u < 260), 40.0, 12.0)
    hidden = (u >= 172) & (u < 200)  # seen by the right camera behind the strip
    near_edge = np.minimum(np.abs(u - 199.5), np.abs(u - 259.5)) < 6
    assert found.known[hidden & ~near_edge].mean() < 0.1
    assert found.known[~hidden & ~near_edge].mean() > 0.9
    assert np.abs(found.values_px - truth)[found.known & ~near_edge & ~hidden].max() < 0.1
    known_near = found.known & near_edge
    assert (np.abs(found.values_px - truth)[known_near] < 1).mean() > 0.8
    anything = SETTINGS.model_copy(update={"max_disagreement_px": 9.0})
    unchecked = measure(frame, places, anything)
    wrong = np.abs(unchecked.values_px - truth)[unchecked.known] > 1
    assert wrong.sum() > (np.abs(found.values_px - truth)[found.known] > 1).sum()


def test_disparity_outside_image_is_unknown(plane, method):
    settings = StereoSettings(method=method)
    places = [[-5, 50], [WIDTH + 5, 50], [200, -5], [200, HEIGHT + 5], [np.nan, 50], [2, 2]]
    assert not measure(plane.frame, np.array(places, float), settings).known.any()
    assert measure(plane.frame, np.zeros((0, 2)), settings).values_px.shape == (0,)
    nothing = StereoFrame(0, plane.frame.left, np.full_like(plane.frame.right, 90))
    assert not measure(nothing, np.array([[200.0, 100.0]]), settings).known.any()


@pytest.mark.parametrize("downscale", [1, 2, 4])
def test_dense_map_is_read_at_the_pixel(downscale):
    """All of it unknown but the one cell that covers the pixel."""
    plane, pixel = Plane(40.3, 0.0, 0.0), np.array([[203.4, 101.6]])
    shape = (HEIGHT // downscale, WIDTH // downscale)
    row, column = 102 // downscale, 203 // downscale  # the pixel that the position rounds to
    settings = StereoSettings(method="semi_global")
    for moved in (0, -1, 1):
        for axis in (0, 1):
            dense = np.full(shape, np.nan, np.float32)
            dense[row + moved * (axis == 0), column + moved * (axis == 1)] = 40
            found = measure_disparities(plane.frame, dense, pixel, settings)
            assert found.known[0] == (moved == 0)


def test_dense_disparity_unrefined_is_unchanged(plane, pixels):
    """As the thesis does."""
    settings = StereoSettings(method="block_matching", downscale=1, refine=False)
    dense = dense_of(plane.frame, settings)
    found = measure_disparities(plane.frame, dense, pixels, settings)
    columns, rows = np.floor(pixels + 0.5).astype(int).T
    np.testing.assert_array_equal(found.values_px, dense[rows, columns])
    error = np.abs(found.values_px - plane.disparity_px(pixels))[found.known]
    assert found.known.mean() > 0.9
    assert 0.01 < np.median(error) < 0.3


@pytest.mark.parametrize("refine", [True, False])
def test_depth_gate_removes_far_points(method, refine):
    plane = Plane(4.0, 0.04, 0.0)  # 8 px at u = 100, 18 px at u = 350
    u = np.linspace(50, 370, 60)
    places = np.column_stack([u, np.full(60, 120.0)])
    gate_px = 12.0
    settings = StereoSettings(method=method, min_disparity_px=gate_px, refine=refine, downscale=1)
    gated = measure(plane.frame, places, settings)
    truth = plane.disparity_px(places)
    assert not gated.known[truth < gate_px - 1].any()
    assert gated.known[(truth > gate_px + 1) & (u > 120)].mean() > 0.8


def test_depth_gate_of_zero_keeps_far_points():
    plane = Plane(0.4, 0.0, 0.0)
    u = np.linspace(50, 370, 60)
    places = np.column_stack([u, np.full(60, 120.0)])
    found = measure(plane.frame, places, StereoSettings(min_disparity_px=0))
    assert found.known.mean() > 0.9
    assert np.abs(found.values_px - 0.4)[found.known].max() < 0.1


def test_disparity_from_wrong_start_is_refused(plane, pixels):
    """The dense map is wrong by 5 px everywhere: alignment finds the truth in almost no case."""
    settings = StereoSettings(method="semi_global")
    wrong = dense_of(plane.frame, settings) + 5
    found = measure_disparities(plane.frame, wrong, pixels, settings)
    assert found.known.mean() < 0.2


def test_disparity_of_tiny_or_blank_pair_is_unknown(method):
    settings = StereoSettings(method=method)
    tiny = np.zeros((20, 30), np.uint8)
    places = np.array([[15.0, 10.0]])
    assert not measure(StereoFrame(0, tiny, tiny), places, settings).known.any()
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert not measure(StereoFrame(0, blank, blank), places * 10, settings).known.any()


def test_disparity_of_same_pair_is_the_same(plane, pixels):
    a, b = (measure(plane.frame, pixels).values_px for _ in range(2))
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
    ("method", "min_known"), [("sparse", 0.58), ("semi_global", 0.53), ("block_matching", 0.45)]
)
def test_disparity_on_motorcycle_is_accurate(motorcycle, method, min_known):
    """At CenSurE features: 95 % of the known ones are right within 1 px, 80 % within 0.5 px."""
    frame, truth = motorcycle
    pixels = detect(frame.left, FeatureSettings(count=1000))
    columns, rows = np.rint(pixels).astype(int).T
    true_px = truth[rows, columns]
    settings = StereoSettings(method=method)
    found = measure(frame, pixels, settings)
    judged = ~np.isnan(true_px)
    known = found.known[judged]
    error = np.abs(found.values_px - true_px)[judged][known]
    figures = f"known {known.mean():.3f}, within 1 px {(error < 1).mean():.3f} of those"
    assert min_known < known.mean() < 0.95, figures
    assert 0.95 < (error < 1).mean() < 0.999, figures
    assert 0.8 < (error < 0.5).mean() < 0.99, figures
    assert 0.01 < np.median(error) < 0.2, figures
