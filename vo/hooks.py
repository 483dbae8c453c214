"""The one place where what a stage found can be replaced from outside, by better or by worse.

The estimator hands out what it has, in its own units, and goes on with what comes back. It learns
nothing of where that came from. Landmarks are known by their identifiers, which last for the whole
run; `born` tells once what surface point each one is.
"""

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.sequence import StereoFrame


class Hooks:
    """Changes nothing; derive and override what shall be replaced.

    Rows stay what they are: each method returns an array of the shape it was given, except for
    `features`. None of them may write into its arguments.
    """

    def features(self, frame: StereoFrame, pixels: Array) -> Array:
        """Features of the left image.

        Args:
            frame: The pair.
            pixels: (N, 2) (u, v) that the detector found, strongest first.

        Returns:
            (M, 2) to go on with.
        """
        return pixels

    def born(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Hear of new landmarks: each is the surface point at a pixel of this frame, for good.

        Args:
            frame: The pair.
            ids: (N,) identifiers. One that is told again, since nothing came of its landmark, is
                another one's from then on.
            pixels: (N, 2) left-image (u, v).
        """

    def predicted(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Pose from which the search for matches starts.

        Args:
            frame: The pair.
            last_ns: Time of the last frame that had a pose.
            T_odom_last: (4, 4) that pose, as estimated.
            T_odom_cam: (4, 4) guess for this frame.
        """
        return T_odom_cam

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Where the landmarks of the map appear.

        Args:
            frame: The pair.
            ids: (L,) every landmark of the map, found or not.
            pixels: (L, 2) left-image (u, v) where it was found; NaN where it was not.

        Returns:
            (L, 2); NaN for landmarks that shall not be used. Any other may be.
        """
        return pixels

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Disparity at features, be they new or matched.

        Args:
            frame: The pair.
            pixels: (N, 2) left-image (u, v).
            disparity_px: (N,) u_left - u_right; NaN where it was not found.

        Returns:
            (N,); NaN where it shall not be used.
        """
        return disparity_px

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Which matches are taken to be right.

        Args:
            frame: The pair.
            ids: (N,) matched landmarks.
            pixels: (N, 2) where they were matched.
            agree: (N,) those that agree with the motion that RANSAC found.
        """
        return agree


UNTOUCHED = Hooks()
"""What an estimator has that nobody interferes with."""
