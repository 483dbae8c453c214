"""Names of the cameras, and which one records unless another is named."""

CAMERAS = {
    "ideal": "perfect pinhole, apart from what a scene sets",
    "machine_vision": "industrial camera: global shutter, low noise, short exposure",
    "stoc": "Videre STOC, 9 cm: global shutter, noisy VGA imagers",
    "webcam": "pair of webcams: rolling shutter, long exposure, compression, colour",
    "d435_infra": "infrared pair of Intel RealSense D435: 5 cm, 87 degrees, global shutter",
    "zed": "Stereolabs ZED: 12 cm, 720p, rolling shutter, colour",
}
"""Name of each camera, and what it is; its file is `imaging/cameras/NAME.toml`."""
IDEAL = "ideal"
DEFAULT_CAMERA = "machine_vision"
"""Camera of recordings, trials and studies that name none."""
