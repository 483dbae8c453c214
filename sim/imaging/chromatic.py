"""Lateral chromatic aberration: the image of red is larger, and that of blue smaller."""

from collections.abc import Callable

import numpy as np

from sim.imaging.lens import pixel_grid
from sim.imaging.resample import sample
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

GREY_WEIGHTS = (0.299, 0.587, 0.114)
"""Share of red, green and blue in the light of a grey image (ITU-R BT.601)."""


def lateral_colour(rig: StereoRig, pad_px: int, shift_px: float) -> Callable[[Array], Array]:
    """Return what red, shifted outwards in the corner, and blue, inwards, make of an image.

    Of light (H + 2 pad, W + 2 pad[, 3]), float32; the shift is proportional to the radius. A grey
    image is the weighted sum of the three colours.
    """
    corner_px = np.hypot(rig.cx_px, rig.cy_px)
    centre = np.array([rig.cx_px, rig.cy_px])
    away = pixel_grid(rig, pad_px) - centre
    places: list[tuple[Array, Array]] = []
    for sign in (1, -1):
        at = away / (1 + sign * shift_px / corner_px) + centre + pad_px
        places.append((at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)))

    def coloured(light: Array) -> Array:
        red, blue = (sample(light, *x) for x in places)
        if light.ndim == 3:
            return np.stack([red[..., 0], light[..., 1], blue[..., 2]], axis=-1)
        r, g, b = (np.float32(x) for x in GREY_WEIGHTS)
        return r * red + g * light + b * blue

    return coloured
