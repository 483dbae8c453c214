"""Settings adapted to an image: wider windows where its noise is strong or its lens defocused.

Where noise is as strong as texture, or texture is coarse, a patch of the usual size holds little
information: windows grow until they hold enough (Kanade and Okutomi, PAMI 1994), by one factor
for the whole image.
"""

from vo.config import OdometrySettings

MAX_SIDE_PX = 31
"""Largest side of a window."""


def adapt_settings(settings: OdometrySettings, low_snr: bool, defocus: bool) -> OdometrySettings:
    """Widen windows and admit less exact disparities and weaker features, as an image demands.

    Args:
        settings: Those of an image that is neither.
        low_snr: Texture hardly exceeds the noise.
        defocus: The lens is out of focus.
    """
    adaptations = ((settings.low_snr, low_snr), (settings.defocus, defocus))
    active = [adaptation for adaptation, needed in adaptations if needed]
    window_scale = max((s.window_scale for s in active), default=1.0)
    search_scale = max((s.search_scale for s in active), default=1.0)
    threshold_scale = settings.defocus.threshold_scale if defocus else 1.0
    sigma_scale = settings.low_snr.sigma_scale if low_snr else 1.0
    features, matching, stereo = settings.features, settings.matching, settings.stereo
    features = features.model_copy(update={"threshold": threshold_scale * features.threshold})
    matching = matching.model_copy(update={"align_px": _widen(matching.align_px, window_scale)})
    stereo = stereo.model_copy(
        update={
            "patch_px": _widen(stereo.patch_px, search_scale),
            "align_px": _widen(stereo.align_px, window_scale),
            "max_sigma_px": sigma_scale * stereo.max_sigma_px,
        }
    )
    return settings.model_copy(
        update={"features": features, "matching": matching, "stereo": stereo}
    )


def adapt_to_blur(settings: OdometrySettings) -> OdometrySettings:
    """Adapt settings to motion blur, which leaves coarse texture and little of it."""
    return adapt_settings(settings, low_snr=True, defocus=True)


def _widen(side_px: int, scale: float) -> int:
    return min(2 * int(side_px * scale / 2) + 1, MAX_SIDE_PX)
