"""Settings of a recording, with units in the names and valid ranges."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sim.camera_settings import CalibrationSettings, ExposureSettings, SensorSettings
from vo.contract.settings import Settings, validated

OptionValue = bool | int | float | str
Waypoint = Annotated[tuple[float, float], Field(description="x, y in world metres")]
MAX_ROVER_MPS = 1.0
"""Largest speed of the rover: that of its wheels' motors, 20 rad/s at a radius of 50 mm."""


class RigSettings(Settings):
    """The stereo pair and its place on the mast."""

    width_px: int = Field(default=640, ge=16, le=4096)
    """Width of each image, px."""
    height_px: int = Field(default=480, ge=16, le=4096)
    """Height of each image, px."""
    hfov_deg: float = Field(default=70.0, ge=10.0, le=150.0)
    """Horizontal field of view, degrees."""
    baseline_m: float = Field(default=0.09, gt=0.0, le=1.0)
    """Distance between the optical centres, m."""
    height_m: float = Field(default=0.5, ge=0.35, le=1.8)
    """Height of the optical centres above level ground, m."""
    tilt_deg: float = Field(default=25.0, ge=-45.0, le=60.0)
    """Angle of the optical axes below the horizon, degrees."""
    rate_hz: float = Field(default=15.0, ge=0.1, le=240.0)
    """Frame rate, Hz."""
    color: bool = False
    """Whether images are RGB; grey otherwise."""


class RoverSettings(Settings):
    """The rover's drive train, load and mast."""

    wheel_torque_max_nm: float = Field(default=1.5, gt=0.0, le=10.0)
    """Largest torque of each wheel motor, N m."""
    load_kg: float = Field(default=0.0, ge=0.0, le=10.0)
    """Mass of a swaying load on springs, high on the left rear, kg; 0: no load."""
    flex_deg: float = Field(default=0.0, ge=0.0, le=20.0)
    """Angle by which a horizontal acceleration of 1 g bends the mast, degrees; 0: rigid."""
    flex_damping: float = Field(default=0.05, gt=0.0, le=1.0)
    """Damping ratio of the bending mast."""


class EncoderSettings(Settings):
    """The wheel encoders."""

    ticks_per_turn: int = Field(default=2000, ge=8, le=1_000_000)
    """Ticks per turn of a wheel."""
    rate_hz: float = Field(default=100.0, ge=1.0, le=1000.0)
    """Sampling rate, Hz."""


class ImuSettings(Settings):
    """The inertial measurement unit on the camera head; noise of the unit used in EuRoC."""

    rate_hz: float = Field(default=200.0, ge=20.0, le=1000.0)
    """Sampling rate, Hz."""
    noise: float = Field(default=1.0, ge=0.0, le=100.0)
    """Factor on the two noise densities and the two random walks; 0: perfect readings."""
    gyroscope_noise_density: float = Field(default=1.6968e-4, ge=0.0)
    """Noise density of the gyroscope, rad/s/sqrt(Hz)."""
    gyroscope_random_walk: float = Field(default=1.9393e-5, ge=0.0)
    """Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz)."""
    accelerometer_noise_density: float = Field(default=2.0e-3, ge=0.0)
    """Noise density of the accelerometer, m/s^2/sqrt(Hz)."""
    accelerometer_random_walk: float = Field(default=3.0e-3, ge=0.0)
    """Random walk of the accelerometer's bias, m/s^3/sqrt(Hz)."""
    position_m: tuple[float, float, float] = (0.06, 0.0, 0.42)
    """Position of the unit in the body frame, m."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the unit's axes in the body frame, degrees."""


class HandheldSettings(Settings):
    """Motion of the rig in the hands of a walking person."""

    sway_m: float = Field(default=0.02, ge=0.0, le=0.2)
    """Amplitude of the vertical and sideways motion of the steps, m."""
    sway_deg: float = Field(default=2.0, ge=0.0, le=20.0)
    """Amplitude of the rotation of the steps, degrees."""
    tremor_deg: float = Field(default=0.15, ge=0.0, le=3.0)
    """Standard deviation of the rotation of the tremor (4 to 12 Hz), degrees."""
    tremor_m: float = Field(default=0.0005, ge=0.0, le=0.02)
    """Standard deviation of the translation of the tremor (4 to 12 Hz), m."""


class DriveSettings(Settings):
    """The carrier of the rig, and how it follows a route of the scene."""

    carrier: Literal["rover", "handheld"] = "rover"
    """Carrier of the rig: the rover, or a walking person."""
    route: str = "default"
    """Name of the route in the scene."""
    waypoints: tuple[Waypoint, ...] = ()
    """Points (x, y) in world metres that replace the scene's route; two or more, or none."""
    distance_m: float | None = Field(default=None, gt=0.0)
    """Path length to drive, m; none: the whole route once. Closed routes repeat."""
    speed_mps: float = Field(default=0.3, ge=0.02, le=1.5)
    """Speed on straights, m/s; the rover's wheels turn at most 20 rad/s, which is 1 m/s."""
    acceleration_mps2: float = Field(default=0.3, gt=0.0, le=3.0)
    """Acceleration and deceleration, m/s^2."""
    turn_rate_max_deg_s: float = Field(default=40.0, gt=0.0, le=240.0)
    """Largest turn rate, degrees/s."""
    lookahead_m: float = Field(default=0.35, ge=0.1, le=2.0)
    """Look-ahead distance of pure pursuit, m."""
    stop_every_m: float = Field(default=0.0, ge=0.0, le=100.0)
    """Path length between halts, m; 0: no halts."""
    stop_s: float = Field(default=0.0, ge=0.0, le=60.0)
    """Duration of each halt, s."""

    @model_validator(mode="after")
    def _rover_reaches_speed(self) -> Self:
        if self.carrier == "rover" and self.speed_mps > MAX_ROVER_MPS:
            raise ValueError(
                f"drive.speed_mps = {self.speed_mps:g}: the rover's wheels turn at most 20 rad/s, "
                f"which is {MAX_ROVER_MPS:g} m/s; only drive.carrier = handheld is faster"
            )
        return self


class TerrainSettings(Settings):
    """Obstacles and slippery patches along the route."""

    brick_mm: float = Field(default=0.0, ge=0.0, le=40.0)
    """Height of loose bricks under the wheels, mm; 0: no bricks."""
    brick_std_mm: float = Field(default=1.0, ge=0.0, le=10.0)
    """Standard deviation of the bricks' height, mm."""
    brick_gap_m: float = Field(default=0.35, ge=0.1, le=5.0)
    """Mean distance from one brick to the next, m."""
    sill_mm: float = Field(default=0.0, ge=0.0, le=25.0)
    """Height of door sills and cables across the route, mm; 0: none."""
    sill_gap_m: float = Field(default=1.2, ge=0.3, le=20.0)
    """Mean distance from one sill or cable to the next, m."""
    ice_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Fraction of the route that slippery patches cover; 0: none."""
    ice_friction: float = Field(default=0.03, ge=0.001, le=1.0)
    """Sliding friction coefficient of the slippery patches."""
    boxes_per_m: float = Field(default=0.0, ge=0.0, le=4.0)
    """Number of light cartons per metre of the route, which the rover pushes along; 0: none."""


class WeatherSettings(Settings):
    """Weather between the cameras and what they see."""

    fog_m: float = Field(default=0.0, ge=0.0, le=100_000.0)
    """Visibility in fog, at which 5 % of the contrast remains, m; 0: clear air."""
    rain_mm_h: float = Field(default=0.0, ge=0.0, le=200.0)
    """Rain, mm/h; 0: dry."""

    @property
    def is_clear(self) -> bool:
        """Whether there is nothing in the air."""
        return self.fog_m == 0 and self.rain_mm_h == 0


class RenderSettings(Settings):
    """Quality of the images; labels do not depend on it."""

    engine: Literal["classic", "filament"] = "classic"
    """Renderer of the images: MuJoCo's classic one, or physically based over Vulkan."""
    backend: Literal["auto", "egl", "osmesa"] = "auto"
    """OpenGL backend; auto: MUJOCO_GL if set, else EGL where a device answers, else OSMesa."""
    samples: int = Field(default=4, ge=0, le=16)
    """Colour samples per pixel; 0: no multisampling."""
    shadow_size_px: int = Field(default=2048, ge=0, le=16384)
    """Side of the shadow map, px; 0: no shadows."""
    near_m: float = Field(default=0.05, gt=0.0, le=0.2)
    """Distance of the near clipping plane, m."""
    far_m: float = Field(default=100.0, ge=20.0, le=1000.0)
    """Distance of the far clipping plane, m."""


class LabelSettings(Settings):
    """Dense labels to write, of the left camera unless stated otherwise."""

    depth: bool = True
    """Depth along the optical axis, m."""
    disparity: bool = True
    """Disparity of the left pixels, px."""
    disparity_right: bool = False
    """Disparity of the right pixels, px."""
    occlusion: bool = False
    """Visibility of each left pixel's point in the right image."""
    flow: bool = False
    """Optical flow to the next left image, px."""
    covisibility: bool = False
    """Visibility of each left pixel's point in the next left image."""
    segmentation: bool = False
    """Number of the object that each pixel shows."""
    classes: bool = False
    """Class of each pixel: sky, ground, static or moving."""
    normals: bool = False
    """Unit surface normals in camera axes."""
    raw_depth: bool = False
    """Distance along the ray, m, of the left raw image, as the lens distorts."""
    raw_flow: bool = False
    """Optical flow to the next left raw image, px."""
    raw_segmentation: bool = False
    """Number of the object that each pixel of the left raw image shows."""

    @property
    def are_raw(self) -> bool:
        """Whether there are labels of the raw image."""
        return self.raw_depth or self.raw_flow or self.raw_segmentation


class RecordSettings(Settings):
    """Settings that, with the scene's name, determine a dataset to the byte."""

    seed: int = Field(default=0, ge=0)
    """Random seed of scene, route and noise."""
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
    weather: WeatherSettings = WeatherSettings()
    render: RenderSettings = RenderSettings()
    labels: LabelSettings = LabelSettings()

    @property
    def exposure_max_ms(self) -> float:
        """Longest exposure of all rows of one camera, ms."""
        longest_ms = self.exposure.time_ms
        if self.sensor.auto_exposure:
            longest_ms = max(longest_ms, self.sensor.exposure_max_ms)
        return longest_ms + self.exposure.line_time_us * 1e-3 * self.rig.height_px

    @model_validator(mode="after")
    def _engine_renders_lens(self) -> Self:
        if self.render.engine == "filament" and self.sensor.lens == "equidistant":
            raise ValueError(
                "sensor.lens = equidistant: the views of a wide lens are rendered by render.engine "
                "= classic only"
            )
        return self

    @model_validator(mode="after")
    def _rain_is_in_pinholes(self) -> Self:
        if self.weather.rain_mm_h and self.sensor.lens == "equidistant":
            raise ValueError(
                f"weather.rain_mm_h = {self.weather.rain_mm_h:g} with sensor.lens = equidistant: "
                "rain is not simulated for wide lenses; set one of both"
            )
        return self

    @model_validator(mode="after")
    def _exposure_fits_frame_interval(self) -> Self:
        interval_ms = 1e3 / self.rig.rate_hz
        open_ms = self.exposure_max_ms + abs(self.exposure.right_offset_ms)
        if open_ms > interval_ms:
            raise ValueError(
                f"exposure.time_ms with readout and right offset takes {open_ms:.1f} ms, but "
                f"rig.rate_hz leaves {interval_ms:.1f} ms from frame to frame"
            )
        return self


def recorded_settings(content: Mapping[str, Any]) -> RecordSettings:
    """Build settings from a manifest, which may have names of an earlier version; all are set.

    Raises:
        SettingsError: If a key or value is not accepted.
    """
    exposure = {
        ExposureSettings.renamed.get(key, key): value
        for key, value in content.get("exposure", {}).items()
    }
    found = validated(RecordSettings, {**content, "exposure": exposure})
    return RecordSettings.model_validate(found.model_dump())
