"""Hooks: the one place where the output of a stage can be replaced from outside.

The estimator passes what a stage found, in its own units, and continues with what comes back.
Landmarks are known by their identifiers, which last for the whole run; `new_landmarks` tells once
what surface point each one is.
"""

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.sequence import StereoFrame


class Hooks:
    """Changes nothing; derive from it and override what is to be replaced.

    Each method returns an array of the shape that it was given, except for `features`. All
    arguments are read-only.
    """

    def __init_subclass__(cls) -> None:
        for former, name in {"born": "new_landmarks", "predicted": "predicted_pose"}.items():
            if former in vars(cls):
                raise TypeError(f"{cls.__name__}.{former}: this hook is now {name}")

    def features(self, frame: StereoFrame, pixels: Array) -> Array:
        """Replace the features of the left image, (N, 2) (u, v), strongest first, by (M, 2)."""
        return pixels

    def new_landmarks(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Receive new landmarks: each is the surface point at a pixel of this frame, for good.

        Args:
            frame: The pair.
            ids: (N,) identifiers. One that comes again denotes the later point.
            pixels: (N, 2) left-image (u, v).
        """

    def predicted_pose(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Replace the pose at which the search for matches starts.

        Args:
            frame: The pair.
            last_ns: Time of the last frame that had a pose.
            T_odom_last: (4, 4) that pose, as estimated.
            T_odom_cam: (4, 4) prediction for this frame.
        """
        return T_odom_cam

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Replace the positions of the map's landmarks in the left image.

        Args:
            frame: The pair.
            ids: (L,) every landmark of the map, matched or not.
            pixels: (L, 2) left-image (u, v) where it was matched; NaN where it was not.

        Returns:
            (L, 2); NaN for landmarks that are not to be used. Any other may be.
        """
        return pixels

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Replace the disparity (N,) at pixels (N, 2) of features; NaN: unknown, or not used."""
        return disparity_px

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Replace the inliers among the matches.

        Args:
            frame: The pair.
            ids: (N,) matched landmarks.
            pixels: (N, 2) where they were matched.
            agree: (N,) those within the inlier threshold.
        """
        return agree


NO_HOOKS = Hooks()
"""Default of an estimator: nothing is replaced."""
