"""Why a pose deserves suspicion: too few landmarks agree, or too many steps led to it."""

from vo.config import OdometrySettings


def explain_doubt(inliers: int, iterations: int, settings: OdometrySettings) -> str:
    """Say in words what is weak about a frame; nothing if it is not."""
    if inliers < settings.motion.weak_inliers:
        return f"{inliers} inliers, fewer than {settings.motion.weak_inliers}"
    if is_unsettled(iterations, settings):
        return f"{iterations} iterations, more than {settings.refinement.max_keyframe_iterations}"
    return ""


def is_unsettled(iterations: int, settings: OdometrySettings) -> bool:
    """Whether a pose's refinement took too long for it to bear a map (thesis 5.3)."""
    return 0 < settings.refinement.max_keyframe_iterations < iterations
