"""Hooks: the one place where the output of a stage can be replaced from outside.

The estimator passes what a stage found, in its own units, and continues with what comes back.
Landmarks are known by their identifiers, which last for the whole run; `new_landmarks` tells once
what surface point each one is.
"""

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.sequence import StereoFrame


class Hooks:
    """Changes nothing; derive from it and override what is to be replaced.

    Each method but `features` returns an array of the shape given. All arguments are read-only.

    Example:
        >>> class Nearer(dy.Hooks):
        ...     def disparity(self, frame, pixels, disparity_px):
        ...         return disparity_px + 0.5
        >>> odometry = dy.StereoOdometry(ds.rig, hooks=Nearer())
    """

    def __init_subclass__(cls) -> None:
        for former, name in {"born": "new_landmarks", "predicted": "predicted_pose"}.items():
            if former in vars(cls):
                raise TypeError(f"{cls.__name__}.{former}: this hook is now {name}")

    def features(self, frame: StereoFrame, pixels: Array) -> Array:
        """Replace the features of the left image, (N, 2) (u, v), strongest first, by (M, 2)."""
        return pixels

    def new_landmarks(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Receive new landmarks (N,): each is the surface point at a pixel (N, 2) of this frame.

        An identifier that comes again denotes the later point.
        """

    def predicted_pose(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Replace the predicted pose (4, 4), at which the search for matches starts.

        The last frame that had a pose, T_odom_last (4, 4), is that of time `last_ns`.
        """
        return T_odom_cam

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Replace the pixels (L, 2) of all landmarks of the map in the left image.

        They are NaN where a landmark was not matched; NaN is returned for those not to be used.
        """
        return pixels

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Replace the disparity (N,) at pixels (N, 2) of features; NaN: unknown, or not used."""
        return disparity_px

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Replace the mask (N,) of the matches, at pixels (N, 2), that are inliers."""
        return agree


NO_HOOKS = Hooks()
"""Default of an estimator: nothing is replaced."""
