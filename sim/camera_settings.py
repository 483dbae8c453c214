"""Settings of a camera: exposure, lens and image sensor, and errors of its calibration."""

from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from vo.contract.settings import Settings


class ExposureSettings(Settings):
    """Exposure time and shutter of the cameras."""

    renamed: ClassVar[Mapping[str, str]] = {"eye_offset_ms": "right_offset_ms"}

    time_ms: float = Field(default=0.0, ge=0.0, le=200.0)
    """Exposure time, centred on the timestamp, ms; 0: an instant."""
    step_px: float = Field(default=1.0, gt=0.05, le=1.0)
    """Largest motion of any pixel from one rendered sub-frame to the next, px."""
    subframes_max: int = Field(default=96, ge=1, le=512)
    """Largest number of rendered sub-frames in a frame."""
    line_time_us: float = Field(default=0.0, ge=0.0, le=200.0)
    """Delay of each row of a rolling shutter, us; 0: global shutter. The middle row is on time."""
    right_offset_ms: float = Field(default=0.0, ge=-50.0, le=50.0)
    """Delay of the right camera's exposure after the left camera's, ms."""


class SensorSettings(Settings):
    """Lens, image sensor and electronics; these defaults are perfect, cameras have their own."""

    lens: Literal["radial_tangential", "equidistant"] = "radial_tangential"
    """Lens model: Brown-Conrady with up to 8 coefficients, or Kannala-Brandt with k1 to k4."""
    fov_deg: float = Field(default=180.0, ge=60.0, le=190.0)
    """Horizontal field of view of the raw images of an equidistant lens, degrees."""
    k1: float = Field(default=0.0, ge=-100.0, le=100.0)
    """First radial distortion coefficient, OpenCV's convention."""
    k2: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Second radial distortion coefficient, OpenCV's convention."""
    p1: float = Field(default=0.0, ge=-0.02, le=0.02)
    """First tangential distortion coefficient, OpenCV's convention."""
    p2: float = Field(default=0.0, ge=-0.02, le=0.02)
    """Second tangential distortion coefficient, OpenCV's convention."""
    k3: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Third radial distortion coefficient, OpenCV's convention."""
    k4: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Fourth coefficient: of the rational model's denominator, or of an equidistant lens."""
    k5: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Fifth coefficient, of the rational model's denominator."""
    k6: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Sixth coefficient, of the rational model's denominator."""
    softness_px: float = Field(default=0.0, ge=0.0, le=12.0)
    """Standard deviation of the lens's Gaussian point spread function, px; 0: sharp."""
    chromatic_px: float = Field(default=0.0, ge=0.0, le=5.0)
    """Shift of red outwards, and of blue inwards, in the image's corner, px."""
    soiling: float = Field(default=0.0, ge=0.0, le=1.0)
    """Amount of dust, drops and fingerprints on each lens; 0: clean."""
    vignetting: float = Field(default=0.0, ge=0.0, le=1.0)
    """Fraction of the light that is lost in the image's corner."""
    response: Literal["srgb", "linear"] = "srgb"
    """Response curve from light to grey level."""
    gamma: float = Field(default=1.0, ge=0.2, le=5.0)
    """Exponent of grey levels after the response curve; above 1, middle levels are darker."""
    black_grey: float = Field(default=0.0, ge=0.0, le=100.0)
    """Grey level of no light, 0 to 255."""
    white_grey: float = Field(default=255.0, ge=101.0, le=1000.0)
    """Grey level of the brightest light; above 255, what is brighter is clipped."""
    auto_exposure: bool = False
    """Whether exposure time, then gain, keep the mean grey level at target_grey."""
    target_grey: float = Field(default=110.0, ge=10.0, le=240.0)
    """Mean grey level that the automatic exposure keeps, 0 to 255."""
    exposure_max_ms: float = Field(default=20.0, gt=0.0, le=200.0)
    """Largest exposure time of the automatic exposure, ms."""
    gain_max_db: float = Field(default=36.0, ge=0.0, le=60.0)
    """Largest gain of the automatic exposure, dB."""
    delay_frames: int = Field(default=2, ge=1, le=10)
    """Frames from an image to the exposure that its grey level determines."""
    gain_db: float = Field(default=0.0, ge=0.0, le=60.0)
    """Fixed gain, also on noise, beside that of the automatic exposure, dB."""
    full_well: float = Field(default=0.0, ge=0.0, le=200_000.0)
    """Electrons at the brightest grey level without gain, for shot noise; 0: no shot noise."""
    read_noise: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Standard deviation of the read noise, electrons (of 10,000 where full_well is 0)."""
    right_gain: float = Field(default=1.0, gt=0.1, le=10.0)
    """Sensitivity of the right camera over that of the left."""
    right_noise: float = Field(default=1.0, ge=0.0, le=20.0)
    """Read noise of the right camera over that of the left."""
    bits: Literal[8, 10, 12] = 8
    """Bits of a grey level as it leaves the sensor; from 10 on, raw images are written, too."""
    jpeg_quality: int = Field(default=0, ge=0, le=100)
    """Quality of the JPEG files in which images leave the camera, with chroma 4:2:2; 0: none."""
    h264_crf: int = Field(default=0, ge=0, le=51)
    """Constant rate factor of the H.264 video in which images leave the camera; 0: none."""
    drop_share: float = Field(default=0.0, ge=0.0, le=0.9)
    """Fraction of the frames that are lost."""

    @model_validator(mode="after")
    def _equidistant_has_4_coefficients(self) -> Self:
        others = [x for x in ("p1", "p2", "k5", "k6") if getattr(self, x)]
        if self.lens == "equidistant" and others:
            raise ValueError(
                f"sensor.{others[0]} = {getattr(self, others[0]):g}: an equidistant lens has k1, "
                "k2, k3 and k4 alone"
            )
        return self

    @model_validator(mode="after")
    def _one_compression_of_8_bits(self) -> Self:
        compressions = {"jpeg_quality": "JPEG", "h264_crf": "H.264"}
        used = [x for x in compressions if getattr(self, x)]
        if used and self.bits > 8:
            raise ValueError(
                f"sensor.{used[0]} = {getattr(self, used[0])} with sensor.bits = {self.bits}: "
                f"{compressions[used[0]]} has 8 bits; set one of both"
            )
        if len(used) > 1:
            raise ValueError(
                f"sensor.h264_crf = {self.h264_crf} with sensor.jpeg_quality = "
                f"{self.jpeg_quality}: a camera compresses once; set one of both to 0"
            )
        return self


class CalibrationSettings(Settings):
    """Errors of the delivered calibration; its angles are turns of the true right camera."""

    baseline_percent: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Error of the delivered baseline, percent of the true one."""
    focal_percent: float = Field(default=0.0, ge=-100.0, le=100.0)
    """Error of the delivered focal length, percent of the true one."""
    roll_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    """Uncalibrated roll of the right camera, degrees, positive clockwise as seen."""
    pitch_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    """Uncalibrated pitch of the right camera, degrees, positive upwards."""
    yaw_deg: float = Field(default=0.0, ge=-45.0, le=45.0)
    """Uncalibrated yaw of the right camera, degrees, positive to the right."""
