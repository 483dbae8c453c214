"""What can be asked of a recording, with units in the names and the valid ranges."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from vo.contract.settings import Settings

OptionValue = bool | int | float | str
Waypoint = Annotated[tuple[float, float], Field(description="x, y in world metres")]


class RigSettings(Settings):
    """The stereo pair and its place on the mast."""

    width_px: int = Field(default=640, ge=16, le=4096)
    height_px: int = Field(default=480, ge=16, le=4096)
    hfov_deg: float = Field(default=70.0, ge=10.0, le=150.0)
    baseline_m: float = Field(default=0.09, gt=0.0, le=0.3)
    height_m: float = Field(default=0.5, ge=0.35, le=1.8)
    """Of the optical centres above level ground."""
    tilt_deg: float = Field(default=25.0, ge=-45.0, le=60.0)
    """Of the optical axes below the horizon."""
    rate_hz: float = Field(default=15.0, ge=1.0, le=240.0)
    color: bool = False


class RoverSettings(Settings):
    """The rover's drive train, its load and its mast."""

    wheel_torque_max_nm: float = Field(default=1.5, gt=0.0, le=10.0)
    load_kg: float = Field(default=0.0, ge=0.0, le=10.0)
    """Carried high on the left rear, on springs: it sways and pulls the rover askew."""
    flex_deg: float = Field(default=0.0, ge=0.0, le=20.0)
    """How far a sideways or forward push of one g would bend the mast; 0 makes it rigid."""
    flex_damping: float = Field(default=0.05, gt=0.0, le=1.0)
    """Of the bending mast, as a share of critical damping."""


class EncoderSettings(Settings):
    """The wheel encoders."""

    ticks_per_turn: int = Field(default=2000, ge=8, le=1_000_000)
    rate_hz: float = Field(default=100.0, ge=1.0, le=1000.0)


class ImuSettings(Settings):
    """The inertial unit on the camera head; noise as of the unit in the EuRoC recordings."""

    rate_hz: float = Field(default=200.0, ge=20.0, le=1000.0)
    noise: float = Field(default=1.0, ge=0.0, le=100.0)
    """Scales all four figures below; 0 gives perfect readings."""
    gyroscope_noise_density: float = Field(default=1.6968e-4, ge=0.0)
    """rad/s/sqrt(Hz)"""
    gyroscope_random_walk: float = Field(default=1.9393e-5, ge=0.0)
    """rad/s^2/sqrt(Hz)"""
    accelerometer_noise_density: float = Field(default=2.0e-3, ge=0.0)
    """m/s^2/sqrt(Hz)"""
    accelerometer_random_walk: float = Field(default=3.0e-3, ge=0.0)
    """m/s^3/sqrt(Hz)"""
    position_m: tuple[float, float, float] = (0.06, 0.0, 0.42)
    """In the body frame."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of its axes in the body frame."""


class HandheldSettings(Settings):
    """How a walking person holds the rig."""

    sway_m: float = Field(default=0.02, ge=0.0, le=0.2)
    """Amplitude of the steps' bobbing and swaying."""
    sway_deg: float = Field(default=2.0, ge=0.0, le=20.0)
    tremor_deg: float = Field(default=0.15, ge=0.0, le=3.0)
    """Deviation of the hand's shaking, 4 to 12 Hz."""
    tremor_m: float = Field(default=0.0005, ge=0.0, le=0.02)


class DriveSettings(Settings):
    """Who carries the rig, and how a route of the scene is followed."""

    carrier: Literal["rover", "handheld"] = "rover"
    route: str = "default"
    waypoints: tuple[Waypoint, ...] = ()
    """A route of one's own; two or more points replace the scene's."""
    distance_m: float | None = Field(default=None, gt=0.0)
    """Path length after which to stop; none: the whole route once. Closed routes repeat."""
    speed_mps: float = Field(default=0.3, ge=0.02, le=1.5)
    acceleration_mps2: float = Field(default=0.3, gt=0.0, le=3.0)
    turn_rate_max_deg_s: float = Field(default=40.0, gt=0.0, le=240.0)
    lookahead_m: float = Field(default=0.35, ge=0.1, le=2.0)
    stop_every_m: float = Field(default=0.0, ge=0.0, le=100.0)
    """Path length between halts; 0: none."""
    stop_s: float = Field(default=0.0, ge=0.0, le=60.0)
    """Length of each halt."""


class TerrainSettings(Settings):
    """What is laid in the rover's way, along the route."""

    brick_mm: float = Field(default=0.0, ge=0.0, le=40.0)
    """Height of loose bricks under the wheels; 0: none."""
    brick_std_mm: float = Field(default=1.0, ge=0.0, le=10.0)
    brick_gap_m: float = Field(default=0.35, ge=0.1, le=5.0)
    """Mean distance from one brick to the next."""
    sill_mm: float = Field(default=0.0, ge=0.0, le=25.0)
    """Height of door sills and cables across the route; 0: none."""
    sill_gap_m: float = Field(default=1.2, ge=0.3, le=20.0)
    ice_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the route that is under slippery patches."""
    ice_friction: float = Field(default=0.03, ge=0.001, le=1.0)
    boxes_per_m: float = Field(default=0.0, ge=0.0, le=4.0)
    """Light cartons that the rover runs into and pushes along."""


class ExposureSettings(Settings):
    """When each pixel gathers light."""

    time_ms: float = Field(default=0.0, ge=0.0, le=200.0)
    """Open shutter, centred on the timestamp; 0: an instant."""
    step_px: float = Field(default=1.0, gt=0.05, le=1.0)
    """Largest motion of any pixel from one rendered sub-frame to the next."""
    subframes_max: int = Field(default=96, ge=1, le=512)
    line_time_us: float = Field(default=0.0, ge=0.0, le=200.0)
    """Delay of each row after the one above: a rolling shutter. The middle row keeps the stamp."""
    right_offset_ms: float = Field(default=0.0, ge=-50.0, le=50.0)
    """How much later the right eye exposes than the left."""


class SensorSettings(Settings):
    """Lens, pixels and electronics; the default camera is perfect."""

    k1: float = Field(default=0.0, ge=-0.5, le=0.5)
    k2: float = Field(default=0.0, ge=-0.5, le=0.5)
    p1: float = Field(default=0.0, ge=-0.02, le=0.02)
    p2: float = Field(default=0.0, ge=-0.02, le=0.02)
    """Radial and tangential distortion, in OpenCV's convention."""
    softness_px: float = Field(default=0.0, ge=0.0, le=12.0)
    """Deviation of the lens's Gaussian point spread."""
    vignetting: float = Field(default=0.0, ge=0.0, le=1.0)
    """Light lost in the image's corner."""
    response: Literal["srgb", "linear"] = "srgb"
    """From light to grey level."""
    auto_exposure: bool = False
    """Hold the mean grey level by exposure time, then by gain."""
    target_grey: float = Field(default=110.0, ge=10.0, le=240.0)
    exposure_max_ms: float = Field(default=20.0, gt=0.0, le=200.0)
    gain_max_db: float = Field(default=36.0, ge=0.0, le=60.0)
    delay_frames: int = Field(default=2, ge=1, le=10)
    """Between a picture and the exposure that answers it."""
    gain_db: float = Field(default=0.0, ge=0.0, le=60.0)
    """Fixed gain on top; also amplifies noise."""
    full_well: float = Field(default=0.0, ge=0.0, le=200_000.0)
    """Electrons at the brightest grey level without gain: the source of shot noise; 0: none."""
    read_noise: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Electrons (of a well of 10,000 where full_well is 0)."""
    right_gain: float = Field(default=1.0, gt=0.1, le=10.0)
    """Sensitivity of the right eye over that of the left."""
    right_noise: float = Field(default=1.0, ge=0.0, le=20.0)
    """Read noise of the right eye over that of the left."""
    drop_share: float = Field(default=0.0, ge=0.0, le=0.9)
    """Of frames that are lost."""


class CalibrationSettings(Settings):
    """How the delivered calibration differs from the true camera."""

    baseline_percent: float = Field(default=0.0, ge=-100.0, le=100.0)
    focal_percent: float = Field(default=0.0, ge=-100.0, le=100.0)
    roll_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    pitch_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    yaw_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    """True turn of the right eye that the calibration does not know: about z, x and y of the
    camera, positive clockwise as seen, upwards and to the right."""


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
    """Which dense labels to write; of the left camera where nothing else is said."""

    depth: bool = True
    disparity: bool = True
    disparity_right: bool = False
    occlusion: bool = False
    flow: bool = False
    covisibility: bool = False
    segmentation: bool = False
    classes: bool = False
    normals: bool = False


class RecordSettings(Settings):
    """Everything that, with the scene's name, determines a dataset to the byte."""

    seed: int = Field(default=0, ge=0)
    scene: Mapping[str, OptionValue] = Field(default_factory=dict[str, OptionValue])
    """Options of the scene's builder."""
    rig: RigSettings = RigSettings()
    rover: RoverSettings = RoverSettings()
    encoders: EncoderSettings = EncoderSettings()
    imu: ImuSettings = ImuSettings()
    handheld: HandheldSettings = HandheldSettings()
    drive: DriveSettings = DriveSettings()
    terrain: TerrainSettings = TerrainSettings()
    exposure: ExposureSettings = ExposureSettings()
    sensor: SensorSettings = SensorSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    render: RenderSettings = RenderSettings()
    labels: LabelSettings = LabelSettings()

    @model_validator(mode="after")
    def _shutter_closes_in_time(self) -> Self:
        interval_ms = 1e3 / self.rig.rate_hz
        longest_ms = self.exposure.time_ms
        if self.sensor.auto_exposure:
            longest_ms = max(longest_ms, self.sensor.exposure_max_ms)
        readout_ms = self.exposure.line_time_us * 1e-3 * self.rig.height_px
        open_ms = longest_ms + readout_ms + abs(self.exposure.right_offset_ms)
        if open_ms > interval_ms:
            raise ValueError(
                f"exposure.time_ms with readout and eye offset takes {open_ms:.1f} ms, but "
                f"rig.rate_hz leaves {interval_ms:.1f} ms from frame to frame"
            )
        return self
