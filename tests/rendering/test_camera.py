"""The camera proved by geometry: known corners, ray casts, and one image warped to the other."""

import dataclasses
import math

import cv2
import mujoco
import numpy as np
import pytest

from sim.camera.render import NO_GEOM, GeometryBuffers, StereoRenderer
from sim.certificate.photometric import residual
from sim.labels.labels import disparity_from_depth, visible_in_right
from sim.preview.cameras import render_map
from sim.settings import RecordSettings, RenderSettings, RigSettings
from sim.world.rig import CAMERA
from sim.world.rover import CONTACT_GROUP
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

pytestmark = pytest.mark.gl

RIGS = (
    RigSettings(),
    RigSettings(
        width_px=401, height_px=300, hfov_deg=95, baseline_m=0.2, tilt_deg=12, height_m=0.7
    ),
)
UNDECIDED_PX = 0.05
"""Pixel centres this close to an outline may fall on either side."""


@pytest.fixture(scope="module", params=RIGS, ids=["default", "wide"])
def world(request, make_scene, settled) -> World:
    return settled(make_scene(boxes=True), RecordSettings(rig=request.param))


@dataclasses.dataclass(frozen=True)
class View:
    left: Image
    right: Image
    geometry: GeometryBuffers


@pytest.fixture(scope="module")
def view(world) -> View:
    return look(world, RenderSettings(samples=4))


@pytest.fixture(scope="module")
def masks(view) -> tuple[Array, Array]:
    return view.geometry.geoms_left, view.geometry.geoms_right


def look(world: World, settings: RenderSettings, color: bool = False) -> View:
    with StereoRenderer(world, settings, color) as renderer:
        return View(*renderer.render_images(), renderer.render_geometry())


def test_pixels_agree_with_projected_boxes(world, masks):
    assert _misplaced(world, world.rig, masks) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"cx_px": 0.1},
        {"cx_px": -0.1},
        {"cy_px": 0.1},
        {"cy_px": -0.1},
        {"f_px": 1.0},
        {"baseline_m": 0.0005},
    ],
    ids=str,
)
def test_projection_off_by_a_tenth_of_a_pixel_is_detected(world, masks, wrong):
    changed = {key: getattr(world.rig, key) + value for key, value in wrong.items()}
    assert _misplaced(world, dataclasses.replace(world.rig, **changed), masks) > 3


def test_swapped_images_are_detected(world, masks):
    assert _misplaced(world, world.rig, masks[::-1]) > 100


def test_stereo_rig_follows_from_its_settings(world):
    rig = world.rig
    assert 2 * math.atan(rig.width_px / 2 / rig.f_px) == pytest.approx(
        math.radians(95 if rig.width_px == 401 else 70)
    )
    assert (rig.cx_px, rig.cy_px) == ((rig.width_px - 1) / 2, (rig.height_px - 1) / 2)
    forward_body = rig.T_body_cam[:3, 2]
    tilt_deg = math.degrees(math.asin(-forward_body[2]))
    assert tilt_deg == pytest.approx(12 if rig.width_px == 401 else 25)
    centre_body = rig.T_body_cam[:3, 3] + rig.T_body_cam[:3, 0] * rig.baseline_m / 2
    T_world_chassis = world.T_world_chassis
    camera = world.data.camera(CAMERA)
    np.testing.assert_allclose(
        se3.transform(T_world_chassis, centre_body[None])[0], camera.xpos, atol=1e-9
    )
    assert camera.xpos[2] == pytest.approx(0.7 if rig.width_px == 401 else 0.5, abs=2e-3)


def test_depth_agrees_with_ray_casts_at_pixel_centres(world, view):
    """Within 0.2 mm at 1 m, and 0.02 % elsewhere, in both images."""
    rng = np.random.default_rng(0)
    pixels = np.column_stack(
        [rng.integers(0, side, 500) for side in (world.rig.width_px, world.rig.height_px)]
    )
    for side, depth_m in enumerate((view.geometry.depth_left_m, view.geometry.depth_right_m)):
        rendered = depth_m[pixels[:, 1], pixels[:, 0]]
        cast = _cast(world, pixels, side)
        assert (np.isnan(rendered) == np.isnan(cast)).all()
        hit = np.isfinite(cast) & (cast < 20)
        assert hit.sum() > 300
        np.testing.assert_allclose(rendered[hit], cast[hit], rtol=2e-4)


def test_labels_do_not_depend_on_image_quality(world, view):
    plain = look(world, RenderSettings(samples=0, shadow_size_px=0))
    for name, label in vars(view.geometry).items():
        np.testing.assert_array_equal(getattr(plain.geometry, name), label)
    assert (plain.left != view.left).any()


def test_right_image_warped_by_disparity_is_left(world, view):
    disparity_px = disparity_from_depth(world.rig, view.geometry.depth_left_m)
    visible = visible_in_right(disparity_px)
    v, u = np.indices(disparity_px.shape, np.float32)

    def median(shift_px: float) -> float:
        u_px = u - disparity_px - np.float32(shift_px)
        return float(np.median(np.abs(residual(view.left, view.right, u_px, v, visible))))

    assert 0.5 < visible.mean() < 1
    assert median(0) < 0.5
    assert min(median(0.25), median(-0.25)) > 1.4 * median(0)


def test_visibility_agrees_with_the_right_depth(world, view):
    """The label's verdict, from left alone, against the depth that the right camera sees there."""
    disparity_px = disparity_from_depth(world.rig, view.geometry.depth_left_m)
    right_px = disparity_from_depth(world.rig, view.geometry.depth_right_m)
    visible = visible_in_right(disparity_px)
    v, u = np.nonzero(visible)
    landed = right_px[v, np.rint(u - disparity_px[v, u]).astype(int)]
    nearer = landed - disparity_px[v, u] > 1.5
    assert 0 < nearer.mean() + 1e-9 < 0.002  # pixels half covered at outlines, and nothing else


def test_rover_is_not_in_its_images(world, masks):
    for ids in masks:
        bodies = world.model.geom_bodyid[np.unique(ids[ids != NO_GEOM])]
        assert (bodies == 0).all()


def test_color_and_grey_images_agree(world, view):
    color = look(world, RenderSettings(samples=4), color=True).left
    assert color.shape == (*view.left.shape, 3)
    np.testing.assert_array_equal(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), view.left)


def test_map_pixels_agree_with_the_map_scale(world):
    extent = (-2.0, -3.0, 6.0, 3.0)
    with StereoRenderer(world, RenderSettings(samples=0, shadow_size_px=0)) as renderer:
        top_down = render_map(renderer, extent)
    image = top_down.image.astype(int)
    assert image.shape == (768, 1024, 3)
    red = (image[..., 0] > 2 * image[..., 1]).astype(np.uint8)
    count, _, _, centroids = cv2.connectedComponentsWithStats(red)
    for k in range(5):
        expected = top_down.pixels(world.data.geom(f"box_{k}").xpos)
        nearest = np.abs(centroids[1:count] - expected).max(axis=1).min()
        assert nearest < 0.35, f"box {k}"


def _misplaced(world: World, rig: StereoRig, masks: tuple[Array, Array]) -> int:
    """Count pixels of either camera whose geom contradicts the projected outlines of the boxes."""
    wrong = 0
    T_cam_world = se3.inverse(world.T_world_chassis @ rig.T_body_cam)
    grid = np.stack(np.meshgrid(np.arange(rig.width_px), np.arange(rig.height_px)), axis=-1)
    outlines = [_outlines(world, rig, T_cam_world, f"box_{k}") for k in range(5)]
    for side, ids in enumerate(masks):
        inside_px = np.array([_inside(outline[side], grid) for outline in outlines])
        for k, depth_px in enumerate(inside_px):
            others = np.delete(inside_px, k, axis=0).max(axis=0) > -1
            decided = (np.abs(depth_px) > UNDECIDED_PX) & ~others
            mine = ids == world.model.geom(f"box_{k}").id
            wrong += int((mine != (depth_px > 0))[decided].sum())
            assert (mine & decided).sum() > 100
    return wrong


def _outlines(world: World, rig: StereoRig, T_cam_world: Array, name: str) -> tuple[Array, Array]:
    """Convex outlines of a box in the left and in the right camera, (M, 2) pixels."""
    geom = world.data.geom(name)
    signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
    corners = geom.xpos + signs * world.model.geom(name).size @ geom.xmat.reshape(3, 3).T
    u, v, d = rig.project(se3.transform(T_cam_world, corners)).T
    hulls = [cv2.convexHull(np.column_stack([x, v]).astype(np.float32)) for x in (u, u - d)]
    return hulls[0][:, 0], hulls[1][:, 0]


def _inside(outline: Array, grid: Array) -> Array:
    """Distance of each pixel centre to the outline's nearest edge line; positive inside."""
    a, b = outline, np.roll(outline, -1, axis=0)
    along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    offset = grid[..., None, :] - a
    cross = along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0]
    orientation = np.sign(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return (cross * orientation).min(axis=-1)


def _cast(world: World, pixels: Array, side: int) -> Array:
    """Planar depth by MuJoCo's ray casts through pixel centres; NaN for the sky."""
    rig = world.rig
    T_world_cam = world.T_world_chassis @ rig.T_body_cam
    origin = T_world_cam[:3, 3] + side * rig.baseline_m * T_world_cam[:3, 0]
    rays_cam = np.column_stack([rig.normalized(pixels), np.ones(len(pixels))])
    groups = np.ones(6, np.uint8)
    groups[CONTACT_GROUP] = 0
    geom = np.zeros(1, np.int32)
    depths = [
        mujoco.mj_ray(world.model, world.data, origin, ray, groups, True, -1, geom)
        for ray in rays_cam @ T_world_cam[:3, :3].T
    ]
    return np.where(np.array(depths) < 0, np.nan, depths)  # rays have unit depth, not unit length
