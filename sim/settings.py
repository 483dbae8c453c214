"""What can be asked of a recording, with units in the names and the valid ranges."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from vo.contract.settings import Settings

OptionValue = bool | int | float | str


class RigSettings(Settings):
    """The stereo pair and its place on the mast; the images are rectified and undistorted."""

    width_px: int = Field(default=640, ge=16, le=4096)
    height_px: int = Field(default=480, ge=16, le=4096)
    hfov_deg: float = Field(default=70.0, ge=10.0, le=150.0)
    baseline_m: float = Field(default=0.09, gt=0.0, le=0.3)
    height_m: float = Field(default=0.5, ge=0.35, le=1.5)
    """Of the optical centres above level ground."""
    tilt_deg: float = Field(default=25.0, ge=-45.0, le=60.0)
    """Of the optical axes below the horizon."""
    rate_hz: float = Field(default=15.0, ge=1.0, le=240.0)
    color: bool = False


class RoverSettings(Settings):
    """The carrier's drive train and encoders."""

    wheel_torque_max_nm: float = Field(default=1.5, gt=0.0, le=10.0)
    encoder_ticks_per_turn: int = Field(default=2000, ge=8, le=1_000_000)
    encoder_rate_hz: float = Field(default=100.0, ge=1.0, le=1000.0)


class DriveSettings(Settings):
    """How the rover follows a route of the scene."""

    route: str = "default"
    distance_m: float | None = Field(default=None, gt=0.0)
    """Path length after which to stop; none: the whole route once. Closed routes repeat."""
    speed_mps: float = Field(default=0.3, ge=0.02, le=0.7)
    acceleration_mps2: float = Field(default=0.3, gt=0.0, le=2.0)
    turn_rate_max_deg_s: float = Field(default=40.0, gt=0.0, le=180.0)
    lookahead_m: float = Field(default=0.35, ge=0.1, le=2.0)


class RenderSettings(Settings):
    """Quality of the pictures; labels do not depend on it."""

    backend: Literal["auto", "egl", "osmesa"] = "auto"
    samples: int = Field(default=4, ge=0, le=16)
    """Colour samples a pixel; 0 switches multisampling off."""
    shadow_size_px: int = Field(default=2048, ge=0, le=16384)
    """Side of the shadow map; 0 switches shadows off."""
    near_m: float = Field(default=0.05, gt=0.0, le=0.2)
    far_m: float = Field(default=100.0, ge=20.0, le=1000.0)


class LabelSettings(Settings):
    """Which dense labels of the left camera to write."""

    depth: bool = True
    disparity: bool = True


class RecordSettings(Settings):
    """Everything that, with the scene's name, determines a dataset to the byte."""

    seed: int = Field(default=0, ge=0)
    scene: Mapping[str, OptionValue] = Field(default_factory=dict[str, OptionValue])
    """Options of the scene's builder."""
    rig: RigSettings = RigSettings()
    rover: RoverSettings = RoverSettings()
    drive: DriveSettings = DriveSettings()
    render: RenderSettings = RenderSettings()
    labels: LabelSettings = LabelSettings()
