"""One layout of a scene: built, mapped, with a rover and its camera in it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from scenes.scene import Scene
from sim.batch import build
from sim.settings import RecordSettings
from sim.world.world import build_world
from trials.gym.world.dynamic_agents import DynamicAgent
from trials.gym.world.dynamics import with_agents
from trials.gym.world.free_space import TraversableSpace, map_free_space
from trials.gym.world.sensors import RoverCamera
from trials.gym.world.simulation import Simulation
from trials.gym.world.start_goal_sampling import main_component
from vo.contract.arrays import Array, Mask
from vo.contract.settings import amended


@dataclass(frozen=True)
class SceneInstance:
    """What is kept from trial to trial: the scene before and after it was compiled, and its camera.

    The traversable space has enough clearance for the rover; the cells (H, W) of the component
    are connected to the scene's own route.
    """

    settings: RecordSettings
    scene: Scene
    simulation: Simulation
    camera: RoverCamera
    traversable: TraversableSpace
    component: Mask

    @property
    def layout(self) -> int:
        """Seed of the scene."""
        return self.settings.seed


def build_instance(
    scene_name: str, settings: RecordSettings, min_clearance_m: float, acceleration_mps2: float
) -> SceneInstance:
    """Build the layout of a scene that is the seed of the settings.

    The rover's axle needs `min_clearance_m`; the rim of a wheel has `acceleration_mps2` at most.

    Raises:
        SettingsError: If scene, option or setting is refused.
        TrialError: If there is no traversable place.
    """
    scene = build(scene_name, settings)
    world = build_world(scene, settings)
    space = map_free_space(world, settings.rig.height_m)
    traversable = TraversableSpace(space, min_clearance_m)
    component = main_component(traversable, world.path.waypoints, scene.name)
    simulation = Simulation(world, settings, acceleration_mps2)
    camera = RoverCamera(world, settings)
    return SceneInstance(settings, scene, simulation, camera, traversable, component)


def rebuilt_along(
    instance: SceneInstance, path: Array, agents: Mapping[str, DynamicAgent]
) -> SceneInstance:
    """Build an instance anew with its terrain along a path (N, 2), and with agents by name.

    Raises a SettingsError if the rover has no room at the start.
    """
    waypoints = tuple((float(x), float(y)) for x, y in path)
    route = {"drive.waypoints": waypoints, "drive.distance_m": None}
    settings = amended(instance.settings, route)
    scene = with_agents(instance.scene, agents, instance.layout)
    world = build_world(scene, settings)
    simulation = Simulation(world, settings, instance.simulation.acceleration_mps2)
    return replace(
        instance,
        settings=settings,
        scene=scene,
        simulation=simulation,
        camera=RoverCamera(world, settings),
    )
