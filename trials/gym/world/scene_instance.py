"""The site: one layout of a scene, built, surveyed, with a rover and its eyes in it."""

from collections.abc import Mapping
from dataclasses import dataclass

from scenes.scene import Scene
from sim.batch import build
from sim.settings import RecordSettings, TerrainSettings
from sim.world.world import build_world
from trials.gym.env.camera import Eyes
from trials.gym.env.settings import TrialSettings, along
from trials.gym.world.distance_field import Passages
from trials.gym.world.dynamic_agents import Reacting
from trials.gym.world.free_space import survey_free_space
from trials.gym.world.obstacle_bodies import with_dynamics
from trials.gym.world.simulation import Simulation
from trials.gym.world.start_goal_sampling import Errand, main_part
from vo.contract.arrays import Mask


@dataclass(frozen=True)
class Site:
    """Everything that outlives a trial.

    Attributes:
        layout: Seed of the scene.
        settings: Resolved, of world and sensors.
        scene: Before it was compiled.
        simulation: Of the compiled world.
        eyes: Of the rover in it.
        passages: Where there is room.
        part: (H, W) cells that are connected to the scene's own route.
    """

    layout: int
    settings: RecordSettings
    scene: Scene
    simulation: Simulation
    eyes: Eyes
    passages: Passages
    part: Mask

    @property
    def follows_way(self) -> bool:
        """Whether what is laid in the rover's way must be laid anew for another way."""
        return self.settings.terrain != TerrainSettings()


def open_site(trial: TrialSettings, layout: int) -> Site:
    """Build a layout.

    Args:
        trial: What was asked for.
        layout: Seed.

    Raises:
        SettingsError: If scene, option or setting is refused.
        TrialError: If there is no free place.
    """
    settings = trial.recorded(layout)
    scene = build(trial.scene, settings)
    world = build_world(scene, settings)
    passages = Passages(survey_free_space(world, settings.rig.height_m), trial.clearance_m)
    part = main_part(passages, world.path.waypoints, scene.name)
    simulation = Simulation(world, settings, trial.acceleration_mps2)
    return Site(layout, settings, scene, simulation, Eyes(world, settings), passages, part)


def relaid(
    site: Site, trial: TrialSettings, errand: Errand, movers: Mapping[str, Reacting] | None = None
) -> Site:
    """Return the site with what is laid in the rover's way along another one.

    Args:
        site: As it was surveyed.
        trial: What was asked for.
        errand: The other way.
        movers: What reacts to the rover, by name.

    Raises:
        SettingsError: If the rover has no room at the start.
    """
    settings = along(site.settings, [(float(x), float(y)) for x, y in errand.waypoints])
    scene = with_dynamics(site.scene, movers or {}, site.layout)
    world = build_world(scene, settings)
    simulation = Simulation(world, settings, trial.acceleration_mps2)
    eyes = Eyes(world, settings)
    return Site(site.layout, settings, scene, simulation, eyes, site.passages, site.part)
