"""What can be asked of a trial."""

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, PositiveFloat, field_validator, model_validator

from scenes import find_scene, scene_options
from sim.disturbances import disturbed, parse_disturbances
from sim.settings import OptionValue, RecordSettings
from trials.gym.env.localization import expect_localization
from trials.gym.world.dynamics import parse_dynamics
from vo.contract.errors import SettingsError
from vo.contract.settings import Settings, amended, resolve

Channel = Literal["left", "right", "disparity", "pose", "encoders", "imu", "goal"]
SEEN: frozenset[Channel] = frozenset({"left", "right", "disparity"})
"""Channels that need a picture."""
FAST: Mapping[str, Any] = {"render.samples": 0, "render.shadow_size_px": 0}
"""Settings in which a trial differs from a recording unless told otherwise: a picture in a third
of the time."""


class TrialSettings(Settings):
    """What all three environments understand."""

    scene: str = Field(default="warehouse", description="name, MJCF file or module:function")
    scene_options: Mapping[str, OptionValue] = Field(
        default_factory=dict[str, OptionValue], description="of the scene's builder"
    )
    layout: int | None = Field(
        default=None,
        ge=0,
        description="seed of the scene; none: whatever seeds a reset, kept by resets without seed",
    )
    disturb: str = Field(default="", description="as on the command line: blur,brick_bump=0.5")
    settings: Mapping[str, Any] = Field(
        default_factory=dict[str, Any], description="recording settings by key.path: rig.width_px"
    )
    observe: tuple[Channel, ...] = Field(default=("left", "right", "goal"), min_length=1)
    action: Literal["twist", "wheels"] = Field(
        default="twist", description="forward and turning speed, or left and right wheel"
    )
    localization: str = Field(
        default="vo",
        description="truth, drift:PERCENT, wheels, vo, another estimator's name, module:Class",
    )
    on_loss: Literal["hold", "end"] = Field(
        default="hold",
        description="an estimator without pose keeps its last one, or ends the trial",
    )
    rate_hz: float = Field(default=15.0, ge=1.0, le=100.0, description="of steps and pictures")
    time_limit_s: float = Field(default=120.0, gt=0.0, le=3600.0)
    speed_max_mps: float = Field(default=0.5, gt=0.0, le=1.5)
    turn_max_radps: float = Field(default=1.0, gt=0.0, le=4.0)
    acceleration_mps2: float = Field(default=1.0, gt=0.0, le=10.0, description="of a wheel's rim")
    clearance_m: float = Field(
        default=0.3, ge=0.21, le=2.0, description="room about the axle wherever a way leads"
    )
    record: bool = Field(default=False, description="remember the drive, for `save_dataset`")

    @field_validator("localization")
    @classmethod
    def _known_source(cls, name: str) -> str:
        try:
            expect_localization(name)
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return name

    def sees(self, localization: str) -> bool:
        """Whether pictures are needed at every step."""
        blind = localization in ("truth", "wheels") or localization.startswith("drift:")
        return bool(SEEN & set(self.observe)) or not blind

    @property
    def driven(self) -> Mapping[str, Any]:
        """Settings of the recorder that say along what its obstacles are laid."""
        return {}

    def recorded(self, layout: int) -> RecordSettings:
        """Resolve the settings of scene, rover and sensors.

        Raises:
            SettingsError: If there is no such scene, option of it, disturbance or setting.
        """
        scene_options(self.scene, self.scene_options)
        base: dict[str, Any] = dict(find_scene(self.scene).defaults)
        base |= {**FAST, **self.settings}
        base |= {
            "seed": layout,
            "scene": dict(self.scene_options),
            "drive.carrier": "rover",
            "rig.rate_hz": self.rate_hz,
            "encoders.rate_hz": self.rate_hz,
            **self.driven,
        }
        settings = resolve(RecordSettings, base=base)
        return disturbed(settings, parse_disturbances(self.disturb))


class NavSettings(TrialSettings):
    """Reach a goal."""

    goal_radius_m: float = Field(default=0.3, gt=0.0, le=5.0)
    distance_m: tuple[PositiveFloat, PositiveFloat] = Field(
        default=(3.0, 10.0), description="least and largest way from start to goal"
    )
    dynamics: str = Field(
        default="", description="what moves on the way: blocked_aisles=1,doors=1,traffic=2"
    )

    @field_validator("dynamics")
    @classmethod
    def _known_kinds(cls, text: str) -> str:
        try:
            parse_dynamics(text)
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return text

    @model_validator(mode="after")
    def _some_distance(self) -> Self:
        if self.distance_m[0] >= self.distance_m[1] or self.distance_m[0] <= self.goal_radius_m:
            raise ValueError(
                f"distance_m {self.distance_m}: the first must be the smaller, and more than "
                f"goal_radius_m {self.goal_radius_m}"
            )
        return self


class RouteSettings(TrialSettings):
    """Follow a route."""

    route: str = Field(default="default", description="of the scene")
    route_m: float | None = Field(default=None, gt=0.0, description="how far; none: all of it")
    stray_m: float = Field(default=1.0, gt=0.0, description="further off the route is a failure")
    goal_radius_m: float = Field(default=0.3, gt=0.0, le=5.0)
    lookahead_m: float = Field(default=0.6, gt=0.0, le=5.0, description="of the goal observed")

    @property
    def driven(self) -> Mapping[str, Any]:
        """The route."""
        return {"drive.route": self.route, "drive.distance_m": self.route_m}


class ExploreSettings(TrialSettings):
    """Cover an area and return."""

    cover_share: float = Field(default=0.8, gt=0.0, le=1.0, description="of what can be reached")
    view_m: float = Field(default=2.0, gt=0.0, le=20.0, description="covered about the rover")
    goal_radius_m: float = Field(default=0.5, gt=0.0, le=5.0, description="about the start")


def along(settings: RecordSettings, waypoints: list[tuple[float, float]]) -> RecordSettings:
    """Return settings with another route, such as a way that was planned."""
    return amended(settings, {"drive.waypoints": tuple(waypoints), "drive.distance_m": None})
