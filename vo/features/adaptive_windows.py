"""Settings that suit the picture at hand: wider windows where it is faint or soft.

Where noise is as strong as texture, or texture is coarse, a patch of the usual size says little:
windows grow until they hold enough (Kanade and Okutomi, PAMI 1994). The size is one for the whole
image.
"""

from vo.config import OdometrySettings

WIDEST_PX = 31


def adapt_settings(settings: OdometrySettings, faint: bool, soft: bool) -> OdometrySettings:
    """Return settings with wider windows, less exact disparities and fainter features, as needed.

    Args:
        settings: For pictures that are neither.
        faint: Texture hardly exceeds the noise.
        soft: The lens is out of focus.
    """
    met = [s for s, needed in ((settings.faint, faint), (settings.soft, soft)) if needed]
    window_growth = max((s.window_growth for s in met), default=1.0)
    search_growth = max((s.search_growth for s in met), default=1.0)
    contrast = settings.soft.threshold_share if soft else 1.0
    sigma_growth = settings.faint.sigma_growth if faint else 1.0
    features, matching, stereo = settings.features, settings.matching, settings.stereo
    features = features.model_copy(update={"threshold": contrast * features.threshold})
    matching = matching.model_copy(update={"align_px": _grown(matching.align_px, window_growth)})
    stereo = stereo.model_copy(
        update={
            "search_px": _grown(stereo.search_px, search_growth),
            "align_px": _grown(stereo.align_px, window_growth),
            "most_sigma_px": sigma_growth * stereo.most_sigma_px,
        }
    )
    return settings.model_copy(
        update={"features": features, "matching": matching, "stereo": stereo}
    )


def adapt_to_blur(settings: OdometrySettings) -> OdometrySettings:
    """Return settings for a picture that motion has smeared: coarse, and texture hardly left."""
    return adapt_settings(settings, faint=True, soft=True)


def _grown(side_px: int, growth: float) -> int:
    return min(2 * int(side_px * growth / 2) + 1, WIDEST_PX)
