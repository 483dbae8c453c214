"""Why a quantity of the twin remains far from that of the real recording, in words."""

from collections.abc import Mapping

from trials.realism.comparison import Distance, summary
from trials.realism.quantities import QUANTITIES, Measured

TEXTURE = "texture of the scene's surfaces: no setting of a camera adds any"
REASONS: Mapping[str, str] = {
    "grey": "how bright the surfaces of the scene are: a curve only moves levels",
    "noise": "texture in flat blocks, or noise that compression or rectification has smoothed",
    "gradient": TEXTURE,
    "power": TEXTURE,
    "edge_width": "foliage, relief and compression: only straight, isolated edges tell the lens",
    "vignetting": "points that both eyes see are few, or near the same distance from the centre",
    "right_gain": "a gain that depends on the grey level",
    "features": TEXTURE,
    "coverage": "where the scene has texture",
    "stereo_matches": TEXTURE,
    "matches": "texture of the scene, and how its parts move through the image",
    "inlier_ratio": "things that move, repeat or hide one another in the scene",
    "stereo_residual": "contrast of the landmarks, and errors of the calibration, not estimated",
    "residual": "contrast of the landmarks, and motion blur, not estimated",
    "disparity": "distances of the scene's things",
    "track_length": "how long the scene's things stay in view, and what repeats",
    "motion": "distances of the scene's things, and pitch and roll of the real carrier",
}
"""What a distance depends on beyond the settings that `match` finds, by the quantity."""


def shortfall(distance: Distance, real: Measured, twin: Measured) -> str:
    """Say how far a quantity is, in which direction, and what it depends on."""
    name = distance.quantity
    values = (summary(x, name) for x in (real, twin))
    means = " and ".join("–" if x is None else f"{x:.4g}" for x in values)
    return (
        f"{QUANTITIES[name].label}: distance {distance.text}, by chance "
        f"{distance.chance or 0:.3f}; mean {means} of the twin; depends on {REASONS[name]}"
    )
