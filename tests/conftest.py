"""Worlds small enough to reason about, for every test that needs one."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import settings

from scenes.scene import Motion, Scene
from sim.settings import RecordSettings
from sim.world.world import World, build_world
from trials.execution import cluster
from vo.contract.arrays import Array

# Time limits say more about a shared machine than about the code. Equal examples in every run:
# a change is judged by what it does. HYPOTHESIS_PROFILE=explore looks for new ones.
settings.register_profile("driftyard", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "driftyard"))

SceneMaker = Callable[..., Scene]

BOXES = (
    # centre (m), half sizes (m), yaw (rad): floating, apart from each other in both eyes
    ((0.85, 0.15, 0.12), (0.05, 0.07, 0.03), 0.3),
    ((1.00, -0.22, 0.10), (0.06, 0.04, 0.05), -0.5),
    ((1.90, 0.45, 0.30), (0.10, 0.15, 0.08), 0.8),
    ((2.20, -0.55, 0.35), (0.15, 0.10, 0.12), 0.2),
    ((5.00, 0.20, 0.45), (0.30, 0.50, 0.25), -0.3),
)

MOVER_M = (0.15, 0.15, 0.10)
"""Half sizes."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first, so that no worker starts a long one when others end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def one_core_each() -> Iterator[None]:
    """Let commands start no workers where those of pytest-xdist fill all cores already."""
    with pytest.MonkeyPatch.context() as patch:
        if "PYTEST_XDIST_WORKER" in os.environ:
            patch.setattr(cluster, "usable_cores", lambda: 0)
        yield


@pytest.fixture(scope="module")
def in_this_process() -> Iterator[None]:
    """Let studies run their jobs in the process of the test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "usable_cores", lambda: 0)
        yield


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """Find a folder of data made by others, or skip: it is not part of the repository."""
    root = Path(__file__).resolve().parents[2] / "shared" / "data"

    def find(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"{root / name} is absent")
        return root / name

    return find


@pytest.fixture(scope="session")
def make_scene() -> SceneMaker:
    """A textured plane with, on request, floating boxes, bricks, a wall across the route, and a
    textured box that moves by itself."""

    def make(
        route: Array | None = None,
        boxes: bool = False,
        bumps: bool = False,
        wall: bool = False,
        mover: Motion | None = None,
    ) -> Scene:
        spec = mujoco.MjSpec()
        # A lamp on the camera and highlights shine differently into each eye.
        spec.visual.headlight.active = 0
        _add_ground(spec)
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=(0.3, 0.2, -1),
            ambient=(0.3, 0.3, 0.3),
        )
        if boxes:
            for k, (centre, size, yaw) in enumerate(BOXES):
                quat = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
                _add_box(spec, f"box_{k}", centre, size, quat)
        if bumps:
            rng = np.random.default_rng(3)
            for i, j in np.ndindex(16, 8):
                centre = (0.5 + 0.2 * i, 0.1 * (j - 3.5), rng.uniform(-0.004, 0.004) - 0.03)
                _add_box(spec, f"brick_{i}_{j}", centre, (0.098, 0.048, 0.034))
        if wall:
            _add_box(spec, "wall", (1.0, 0, 0.3), (0.05, 2, 0.3))
        if route is None:
            route = np.array([[0.0, 0.0], [3.0, 0.0]])
        if mover is not None:
            _add_mover(spec)
        return Scene(
            "toy",
            "The tests.",
            spec,
            {"default": route},
            (-2.0, -3.0, 6.0, 3.0),
            movers={} if mover is None else {"mover": mover},
        )

    return make


@pytest.fixture(scope="session")
def settled() -> Callable[[Scene, RecordSettings], World]:
    """Compile a scene and let the rover come to rest at the start."""

    def settle(scene: Scene, settings: RecordSettings) -> World:
        world = build_world(scene, settings)
        mujoco.mj_step(world.model, world.data, 1000)
        world.place_bodies()
        return world

    return settle


def _add_ground(spec: mujoco.MjSpec) -> None:
    coarse = np.random.default_rng(1).integers(60, 190, (64, 64), dtype=np.uint8)
    smooth = cv2.resize(coarse, (256, 256), interpolation=cv2.INTER_CUBIC)
    texture = spec.add_texture(
        name="noise", type=mujoco.mjtTexture.mjTEXTURE_2D, width=256, height=256, nchannel=3
    )
    texture.data = np.repeat(smooth[..., None], 3, axis=2).tobytes()
    ground = spec.add_material(name="ground", texuniform=True, texrepeat=(0.5, 0.5), specular=0)
    ground.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "noise"
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(30, 30, 1), material="ground"
    )


def _add_mover(spec: mujoco.MjSpec) -> None:
    spec.worldbody.add_body(name="mover", mocap=True).add_geom(
        name="mover", type=mujoco.mjtGeom.mjGEOM_BOX, size=MOVER_M, material="ground"
    )


def _add_box(
    spec: mujoco.MjSpec,
    name: str,
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    quat: tuple[float, float, float, float] = (1, 0, 0, 0),
) -> None:
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        size=size,
        quat=quat,
        rgba=(0.9, 0.1, 0.1, 1),
    )
