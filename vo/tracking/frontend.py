"""How images are looked at: by wide windows where they are faint or soft, smoothed where noisy."""

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.sequence import StereoFrame
from vo.features.adaptive_windows import adapt_settings
from vo.features.image_quality import measure_image_quality
from vo.hooks import Hooks
from vo.map.frame import View, look
from vo.stereo.dense import DenseStereo
from vo.tracking.replacement import replace_features


class Eyes:
    """Turns frames into views; images that have once been found noisy are smoothed ever after."""

    def __init__(self, settings: OdometrySettings, hooks: Hooks) -> None:
        """Look by these settings, which suit the picture; hooks may replace features."""
        self._settings, self._hooks = settings, hooks
        self._dense_stereo = DenseStereo(settings.stereo)
        self._smoothing_px = 0.0

    def look(self, frame: StereoFrame, clock: Clock) -> View:
        """Find features (thesis 3.2) and, if stereo is dense, depth (3.1)."""
        s = self._settings
        with clock("features"):
            seen = measure_image_quality(frame.left)
        if seen.noise > s.features.noise_threshold_grey:
            self._smoothing_px = s.features.smoothing_px
        low_snr = seen.texture_to_noise < s.low_snr.texture_to_noise
        settings = adapt_settings(s, low_snr, defocus=0 < s.defocus.softness < seen.softness)
        view = look(frame, self._dense_stereo, settings, clock, self._smoothing_px)
        return replace_features(self._hooks, view, settings)
