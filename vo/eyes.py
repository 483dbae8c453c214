"""How images are looked at: by wide windows where they are faint or soft, smoothed where noisy."""

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks
from vo.noise import Grain, grain
from vo.replacement import replace_features
from vo.stereo import DenseStereo
from vo.view import View, look
from vo.windows import suited


class Eyes:
    """Turns frames into views; images that have once been found noisy are smoothed ever after."""

    def __init__(self, settings: OdometrySettings, hooks: Hooks) -> None:
        """Look by these settings, which suit the picture; hooks may replace features."""
        self._settings, self._hooks = settings, hooks
        self._dense_stereo = DenseStereo(settings.stereo)
        self._smoothing_px = 0.0

    def look(self, frame: StereoFrame, clock: Clock) -> View:
        """Find features (thesis 3.2) and, if stereo is dense, depth (3.1)."""
        features = self._settings.features
        with clock("features"):
            seen = grain(frame.left)
        if seen.noise > features.noisy_grey:
            self._smoothing_px = features.smoothing_px
        settings = self._suited(seen)
        view = look(frame, self._dense_stereo, settings, clock, self._smoothing_px)
        return replace_features(self._hooks, view, settings)

    def _suited(self, seen: Grain) -> OdometrySettings:
        """The settings for a picture; themselves, if nothing is wrong with it."""
        s = self._settings
        faint = seen.texture_to_noise < s.faint.texture_to_noise
        soft = 0 < s.soft.softness < seen.softness
        return suited(s, faint, soft) if faint or soft else s
