"""Options of the environments."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, PositiveFloat, model_validator

from scenes import find_scene, scene_options
from sim.camera_names import DEFAULT_CAMERA
from sim.cameras import camera_values
from sim.disturbances import disturbed, disturbed_values, parse_disturbances
from sim.settings import OptionValue, RecordSettings
from trials.gym.env.localization import expect_localization
from trials.gym.world.dynamics import parse_dynamics
from trials.gym.world.scene_instance import SceneInstance, build_instance
from vo.contract.errors import SettingsError
from vo.contract.settings import Settings, flattened, resolve

CHANNELS = ("left", "right", "disparity", "pose", "encoders", "imu", "goal")
IMAGE_CHANNELS = frozenset({"left", "right", "disparity"})
FAST: Mapping[str, Any] = {"render.samples": 0, "render.shadow_size_px": 0}
"""Recording settings that differ by default in trials: an image takes a third of the time."""


def _checked_by(check: Callable[[str], object]) -> AfterValidator:
    """Validate a text by a function that raises SettingsError."""

    def validate(text: str) -> str:
        try:
            check(text)
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return text

    return AfterValidator(validate)


def _known_channels(wanted: str | tuple[str, ...]) -> str | tuple[str, ...]:
    """Validate the names of channels, or the name of one."""
    names = (wanted,) if isinstance(wanted, str) else wanted
    unknown = sorted(set(names) - set(CHANNELS))
    if unknown or not names:
        found = f"unknown channel {', '.join(unknown)}" if unknown else "names no channel"
        raise ValueError(f"{found}; valid: {', '.join(CHANNELS)}")
    return wanted


class TrialSettings(Settings):
    """Options of all environments."""

    scene: Annotated[str, BeforeValidator(lambda x: str(x) if isinstance(x, Path) else x)] = (
        "warehouse"
    )
    """Scene: name, MJCF file or module:function."""
    scene_options: Mapping[str, OptionValue] = Field(default_factory=dict[str, OptionValue])
    """Options of the scene's builder."""
    layout: int | None = Field(default=None, ge=0)
    """Seed of the scene; none: the seed of the reset, kept by resets without a seed."""
    layouts_kept: int = Field(default=2, ge=1, le=1000)
    """Number of layouts that remain in memory, the present one included; 0.1 to 0.3 GB each."""
    camera: str = DEFAULT_CAMERA
    """Camera: name, or a TOML file of recording settings."""
    disturb: str = ""
    """Disturbances as on the command line: blur,brick_bump=0.5."""
    settings: Mapping[str, Any] = Field(default_factory=dict[str, Any])
    """Recording settings by key: rig.width_px."""
    observe: Annotated[str | tuple[str, ...], AfterValidator(_known_channels)] = (
        "left", "right", "goal",
    )  # fmt: skip
    """Channels of an observation, of left, right, disparity, pose, encoders, imu, goal; one name
    alone is the observation."""
    action: Literal["twist", "wheels"] = "twist"
    """Meaning of an action: forward and turning speed, or left and right wheel."""
    localization: Annotated[str, _checked_by(expect_localization)] = "vo"
    """Source of the pose: truth, drift:PERCENT, wheels, vo, another estimator's name, or
    module:Class."""
    on_loss: Literal["hold", "end"] = "hold"
    """Without a pose, the localization keeps the last one, or the trial ends."""
    rate_hz: float = Field(default=15.0, ge=1.0, le=100.0)
    """Rate of control steps and images, Hz."""
    time_limit_s: float = Field(default=120.0, gt=0.0, le=3600.0)
    """Longest duration of a trial, s."""
    speed_max_mps: float = Field(default=0.5, gt=0.0, le=1.5)
    """Forward speed of an action of 1, m/s."""
    turn_max_radps: float = Field(default=1.0, gt=0.0, le=4.0)
    """Turning speed of an action of 1, rad/s."""
    acceleration_mps2: float = Field(default=1.0, gt=0.0, le=10.0)
    """Largest acceleration of a wheel's rim, m/s^2."""
    clearance_m: float = Field(default=0.3, ge=0.21, le=2.0)
    """Distance from obstacles that paths of the rover's axle keep, m."""
    record: bool = False
    """Log the trial for save_dataset."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the observed channels."""
        return (self.observe,) if isinstance(self.observe, str) else self.observe

    @property
    def max_steps(self) -> int:
        """Steps until the time limit."""
        return math.ceil(self.time_limit_s * self.rate_hz - 1e-9)

    def needs_images(self, localization: str) -> bool:
        """Whether images are needed at every step."""
        without = localization in ("truth", "wheels") or localization.startswith("drift:")
        return bool(IMAGE_CHANNELS & set(self.channels)) or not without

    @property
    def route_settings(self) -> Mapping[str, Any]:
        """Recording settings of the route along which the scene's obstacles are placed."""
        return {}

    def recorded(self, layout: int) -> RecordSettings:
        """Resolve the settings of scene, rover and sensors, or raise a SettingsError."""
        scene_options(self.scene, self.scene_options)
        wanted = parse_disturbances(self.disturb)
        stated = {*flattened(self.settings), *disturbed_values(wanted)}
        base: dict[str, Any] = {
            **find_scene(self.scene).defaults,
            **camera_values(self.camera, stated),
            **FAST,
            **self.settings,
            "seed": layout,
            "scene": dict(self.scene_options),
            "drive.carrier": "rover",
            "rig.rate_hz": self.rate_hz,
            "encoders.rate_hz": self.rate_hz,
            **self.route_settings,
        }
        return disturbed(resolve(RecordSettings, base=base), wanted)

    def build(self, layout: int) -> SceneInstance:
        """Build a layout; raises as `recorded` and `build_instance`."""
        settings = self.recorded(layout)
        return build_instance(self.scene, settings, self.clearance_m, self.acceleration_mps2)


class NavSettings(TrialSettings):
    """Options of RoverNav."""

    goal_radius_m: float = Field(default=0.3, gt=0.0, le=5.0)
    """Distance from the goal that counts as success, m."""
    distance_m: tuple[PositiveFloat, PositiveFloat] = (3.0, 10.0)
    """Shortest and longest path from start to goal, m."""
    dynamics: Annotated[str, _checked_by(parse_dynamics)] = ""
    """Dynamic agents on the path: blocked_aisles=1,doors=1,traffic=2."""

    @model_validator(mode="after")
    def _some_distance(self) -> Self:
        if self.distance_m[0] >= self.distance_m[1] or self.distance_m[0] <= self.goal_radius_m:
            raise ValueError(
                f"distance_m {self.distance_m}: the first must be the smaller, and more than "
                f"goal_radius_m {self.goal_radius_m}"
            )
        return self


class RouteSettings(TrialSettings):
    """Options of RoverRoute."""

    route: str = "default"
    """Name of the scene's route."""
    route_m: float | None = Field(default=None, gt=0.0)
    """Length of the route, m; none: all of it."""
    stray_m: float = Field(default=1.0, gt=0.0)
    """Distance from the route that counts as failure, m."""
    goal_radius_m: float = Field(default=0.3, gt=0.0, le=5.0)
    """Distance from the end that counts as success, m."""
    lookahead_m: float = Field(default=0.6, gt=0.0, le=5.0)
    """Distance of the observed goal along the route, m."""

    @property
    def route_settings(self) -> Mapping[str, Any]:
        """The route."""
        return {"drive.route": self.route, "drive.distance_m": self.route_m}


class ExploreSettings(TrialSettings):
    """Options of RoverExplore."""

    cover_share: float = Field(default=0.8, gt=0.0, le=1.0)
    """Fraction of the reachable ground to bring in view."""
    view_m: float = Field(default=2.0, gt=0.0, le=20.0)
    """Range within which ground is in view, m."""
    goal_radius_m: float = Field(default=0.5, gt=0.0, le=5.0)
    """Distance from the start that ends the trial, m."""
