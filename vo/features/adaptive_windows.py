"""Settings that suit the picture at hand: wider windows where it is faint or soft.

Where noise is as strong as texture, or texture is coarse, a patch of the usual size says little:
windows grow until they hold enough (Kanade and Okutomi, PAMI 1994). The size is one for the whole
image.
"""

from vo.config import OdometrySettings

WIDEST_PX = 31


def adapt_settings(settings: OdometrySettings, low_snr: bool, defocus: bool) -> OdometrySettings:
    """Return settings with wider windows, less exact disparities and fainter features, as needed.

    Args:
        settings: For pictures that are neither.
        low_snr: Texture hardly exceeds the noise.
        defocus: The lens is out of focus.
    """
    met = [s for s, needed in ((settings.low_snr, low_snr), (settings.defocus, defocus)) if needed]
    window_scale = max((s.window_scale for s in met), default=1.0)
    search_scale = max((s.search_scale for s in met), default=1.0)
    contrast = settings.defocus.threshold_scale if defocus else 1.0
    sigma_scale = settings.low_snr.sigma_scale if low_snr else 1.0
    features, matching, stereo = settings.features, settings.matching, settings.stereo
    features = features.model_copy(update={"threshold": contrast * features.threshold})
    matching = matching.model_copy(update={"align_px": _grown(matching.align_px, window_scale)})
    stereo = stereo.model_copy(
        update={
            "patch_px": _grown(stereo.patch_px, search_scale),
            "align_px": _grown(stereo.align_px, window_scale),
            "max_sigma_px": sigma_scale * stereo.max_sigma_px,
        }
    )
    return settings.model_copy(
        update={"features": features, "matching": matching, "stereo": stereo}
    )


def adapt_to_blur(settings: OdometrySettings) -> OdometrySettings:
    """Return settings for a picture that motion has smeared: coarse, and texture hardly left."""
    return adapt_settings(settings, low_snr=True, defocus=True)


def _grown(side_px: int, growth: float) -> int:
    return min(2 * int(side_px * growth / 2) + 1, WIDEST_PX)
