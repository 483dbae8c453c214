"""Earlier names of modules: importing one raises an error that names the new one."""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

COMMANDS = {
    "trials.accuracy": "accuracy",
    "trials.bench": "bench",
    "trials.bump": "bump",
    "trials.gate.simulate": "gate power",
    "trials.gym.bench": "trial-speed",
    "trials.gym.memory": "trial-memory",
    "trials.gym.showcase": "trial-film",
    "trials.navigation.bench": "replanning",
    "trials.point_world": "point-world",
    "trials.proof": "label-accuracy",
    "trials.response": "response",
    "trials.systems.install": "systems install",
}
"""Earlier programs, `python -m NAME`, to commands of `driftyard`."""

ROOMS = {
    ("vo.contract", "sim.dataset"): "encoders>image_codecs",
    ("vo", "vo.bundle_adjustment"): (
        "refine>adjust fixed_lag bundle>problem sandwich>robust_covariance reduction>schur solver"
    ),
    ("vo", "vo.features"): (
        "censure kernels>censure_kernels features>detector harris noise>image_quality "
        "octagons>integral_images subpixel"
    ),
    ("vo", "vo.map"): "view>frame tracks>local_map history>run_history journey>state",
    ("vo", "vo.mapping"): (
        "smoothing>batch_smoothing mapping>keyframes recovery>relocalization "
        "local_bundle>window_adjustment"
    ),
    ("vo", "vo.patches"): "alignment templates matching>zncc",
    ("vo", "vo.pose"): (
        "orientation>absolute_orientation split>decoupled motion>estimation fischler_bolles "
        "pose_steps>gauss_newton annealing>graduated_nonconvexity hypotheses lambda_twist p3p "
        "polynomial ransac"
    ),
    ("vo", "vo.stereo"): (
        "stereo>dense epipolar>epipolar_search surface>plane_fit slant disparity>sparse"
    ),
    ("vo", "vo.tracking"): (
        "correspondence>association eyes>frontend following>klt trust>landmark_prior "
        "localisation>pose_refinement turn>rotation_prior standing>stationary "
        "location>track_local_map"
    ),
    ("sim", "sim.camera"): "camera exposure target>framebuffer gl render sky",
    ("sim", "sim.certificate"): "certificate verify",
    ("sim", "sim.dataset"): "manifest tables",
    ("sim", "sim.imaging"): (
        "metering>auto_exposure imaging>image_sensor lens light>linear_light resample"
    ),
    ("sim", "sim.labels"): "annotate labels visibility>labels",
    ("sim", "sim.preview"): (
        "chase>cameras colours film plates>label_plates map>cameras preview "
        "chart>route_map sights>sample_views"
    ),
    ("sim", "sim.sensors"): "inertial encoders>wheel_encoders",
    ("sim", "sim.world"): "drive handheld path streams>random_streams rig rover terrain trip world",
    ("scenes", "scenes.geometry"): "mesh routes",
    ("scenes", "scenes.lighting"): "light>baked_light lamplight>lamps shadow",
    ("scenes", "scenes.objects"): (
        "exhibits furniture laboratory>laboratory_equipment people plants props storage vehicles"
    ),
    ("scenes", "scenes.structures"): (
        "facade ground interior paths paving ribbon slope surround thresholds"
    ),
    ("trials", "trials.diagnosis"): (
        "attribution bound combinations injection>error_injection explanation oracles validation"
    ),
    ("trials", "trials.estimators"): "baselines estimators>choice plugins systems",
    ("trials", "trials.evaluation"): (
        "alignment consistency information intervals metrics runs score truth"
    ),
    ("trials", "trials.execution"): "outcomes>jobs workers>parallel lab>runner",
    ("trials.gym", "trials.gym.env"): (
        "environments watch>episode localization policies dataset>rover_env rover_env settings "
        "spaces tasks"
    ),
    ("trials.gym", "trials.gym.media"): "film pictures>trial_view window>trial_view",
    ("trials.gym", "trials.gym.studies"): (
        "aisles>aisle_network planning rays>planning ledger>trial_results follower>route_follower "
        "routed>rover_routing routed_figure>rover_routing_figure sensitivity "
        "protocol>trial_results fleet>trial_runner"
    ),
    ("trials.gym", "trials.gym.world"): (
        "eyes>camera ways>distance_field reacting>dynamic_agents barriers>dynamic_agents "
        "carts>dynamic_agents dynamics freespace>free_space inertial bodies>obstacle_bodies "
        "site>scene_instance simulation diary>simulation places>start_goal_sampling"
    ),
    ("trials.navigation", "trials.navigation"): (
        "lookout>depth_mapping occupancy>occupancy_grid grid_planner>planner"
    ),
    ("trials.report", "trials.report"): "explanation>explanation_figures film>stills",
    ("trials", "trials.studies"): (
        "accuracy bench bump experiments proof>label_accuracy point_world response speed stress"
    ),
    ("trials.gate", "trials.studies"): "simulate>gate_power",
    ("trials.navigation", "trials.studies"): "bench>replanning",
    ("trials.report", "trials.studies"): "stress>stress_report",
}
"""Earlier and present package to the modules that moved; `old>new` where the name changed, too."""

MOVED = {
    f"{old}.{word.partition('>')[0]}": f"{new}.{word.rpartition('>')[2]}"
    for (old, new), words in ROOMS.items()
    for word in words.split()
}
"""Earlier name of a module or package to its present one."""
PACKAGES = tuple(
    f"trials.{name}" for name in ("baselines", "experiments", "plugins", "speed", "systems")
)
"""Packages that moved with all of their modules."""


def new_name(name: str) -> str:
    """Return the present name of a module, or of the command; empty if it has not moved."""
    if name in COMMANDS:
        return f"`driftyard {COMMANDS[name]}`"
    for package in PACKAGES:
        if name.startswith(f"{package}."):
            return MOVED[package] + name.removeprefix(package)
    return MOVED.get(name, "")


class MovedModules:
    """Finder of last resort on `sys.meta_path`, for modules that no other finder knows."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find nothing.

        Raises:
            ImportError: If the module has moved; names the present one.
            SystemExit: Likewise, with status 2, for `python -m NAME`.
        """
        new = new_name(name)
        if not new:
            return None
        if sys.argv[:1] == ["-m"]:  # as long as `python -m` looks for the module
            asked = sys.orig_argv[sys.orig_argv.index("-m") + 1]
            print(f"driftyard: error: {asked} is now {new_name(asked) or new}", file=sys.stderr)
            raise SystemExit(2)
        raise ImportError(f"{name} is now {new}", name=name)


def install() -> None:
    """Let imports of earlier names fail with the present ones."""
    if not any(isinstance(x, MovedModules) for x in sys.meta_path):
        sys.meta_path.append(MovedModules())  # pyright: ignore[reportArgumentType]
