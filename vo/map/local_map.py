"""Landmarks, keyframes, and the window of keyframes in which landmarks are still known."""

from dataclasses import dataclass, replace

import numpy as np

from vo.bundle_adjustment.fixed_lag import FixedLag
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask


@dataclass(frozen=True)
class Sighting:
    """What a frame saw.

    Attributes:
        left: (H, W) uint8.
        ids: (N,) landmarks that agreed with its motion, ascending.
        pixels: (N, 2) where.
    """

    left: Image
    ids: Indices
    pixels: Array


@dataclass(frozen=True)
class Keyframe:
    """A frame that is kept, with the landmarks that agreed with its pose.

    Attributes:
        serial: Counts the keyframes of a run.
        T_odom_cam: (4, 4) left camera in the first left camera's frame.
        covariance: (6, 6) of it, tangent (v m, w rad) in the camera's frame.
        left: (H, W) uint8, the source of templates.
        ids: (N,) landmarks seen, ascending.
        measured: (N, 3) left-image u, v and disparity, pixels; the disparity NaN where unknown.
        sigma: (N, 3) their standard deviations.
    """

    serial: int
    T_odom_cam: Array
    covariance: Array
    left: Image
    ids: Indices
    measured: Array
    sigma: Array

    @property
    def sighting(self) -> Sighting:
        """What it saw of its landmarks."""
        return Sighting(self.left, self.ids, self.measured[:, :2])


@dataclass(frozen=True)
class Landmarks:
    """Points that the next frame may see again, row by row.

    Attributes:
        ids: (N,) ascending, unique over the whole run.
        points_odom: (N, 3) metres.
        vectors: (N, P) latest appearance, for matching.
        views: (N,) frames that saw the landmark, keyframes or not.
        anchor: (N,) serial of the keyframe that holds the template for alignment.
        anchor_pixels: (N, 2) template centre in that keyframe.
        anchor_depth_m: (N,) depth there.
        anchor_slopes: (N, 2) slant of the surface there: change of disparity per pixel along u, v.
    """

    ids: Indices
    points_odom: Array
    vectors: Array
    views: Indices
    anchor: Indices
    anchor_pixels: Array
    anchor_depth_m: Array
    anchor_slopes: Array

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, rows: Mask | Indices) -> "Landmarks":
        """Keep some rows."""
        return Landmarks(**{name: value[rows] for name, value in vars(self).items()})

    def extend(self, other: "Landmarks") -> "Landmarks":
        """Append rows, whose ids must be larger."""
        if len(self) == 0:
            return other
        mine, theirs = vars(self), vars(other)
        return Landmarks(**{name: np.concatenate([mine[name], theirs[name]]) for name in mine})

    def update(self, rows: Indices | Mask, **columns: Array) -> "Landmarks":
        """Replace the named columns of some rows."""
        renewed = {name: getattr(self, name).copy() for name in columns}
        for name, values in columns.items():
            renewed[name][rows] = values
        return replace(self, **renewed)


@dataclass(frozen=True)
class LocalMap:
    """The last keyframes and the landmarks that they saw.

    Attributes:
        keyframes: Oldest first.
        landmarks: Those whose anchor is among the keyframes.
        next_serial: Of the next keyframe.
        next_id: Of the next landmark.
        noise: By how much errors of pixels and of disparities exceed what is assumed, as far as
            residuals have shown.
        first_serial: Of the first keyframe, be it in the window or not.
        lag: What keyframes that left the window left behind, if refinement is incremental.
    """

    keyframes: tuple[Keyframe, ...]
    landmarks: Landmarks
    next_serial: int
    next_id: int
    noise: tuple[float, float] = (1.0, 1.0)
    first_serial: int = 0
    lag: FixedLag | None = None

    def seen(self, rows: Indices, features: Indices, vectors: Array) -> "LocalMap":
        """Count a view of some landmarks; renew the appearance of those that have a feature.

        Args:
            rows: (N,) landmarks.
            features: (N,) their rows among `vectors`, negative for none.
            vectors: (F, P) appearances of the view's features.
        """
        landmarks = self.landmarks.update(rows, views=self.landmarks.views[rows] + 1)
        answered = features >= 0
        return replace(
            self, landmarks=landmarks.update(rows[answered], vectors=vectors[features[answered]])
        )

    def grey(self) -> Image:
        """Brightness of each landmark where its template was cut: (N,) uint8."""
        grey = np.zeros(len(self.landmarks), np.uint8)
        for keyframe in self.keyframes:
            here = self.landmarks.anchor == keyframe.serial
            u, v = np.rint(self.landmarks.anchor_pixels[here]).astype(np.int64).T
            grey[here] = keyframe.left[v, u]
        return grey

    def moved(self, T_new_old: Array, covariance: Array) -> "LocalMap":
        """Carry all poses and points by a rigid motion of the odometry frame.

        Args:
            T_new_old: (4, 4).
            covariance: (6, 6) of the last keyframe afterwards; the others' follow from it.
        """
        last = T_new_old @ self.keyframes[-1].T_odom_cam

        def carried(k: Keyframe) -> Keyframe:
            T = T_new_old @ k.T_odom_cam
            spread = se3.transform_covariance(se3.inverse(T) @ last, covariance)
            return replace(k, T_odom_cam=T, covariance=spread)

        points = se3.transform(T_new_old, self.landmarks.points_odom)
        landmarks = replace(self.landmarks, points_odom=points)
        keyframes = tuple(map(carried, self.keyframes))
        return replace(self, keyframes=keyframes, landmarks=landmarks, lag=None)


def empty_map(
    next_serial: int = 0, next_id: int = 0, noise: tuple[float, float] = (1.0, 1.0)
) -> LocalMap:
    """A map without keyframes or landmarks, which goes on counting from another one."""
    none = np.zeros(0, dtype=np.int64)
    landmarks = Landmarks(
        ids=none,
        points_odom=np.zeros((0, 3)),
        vectors=np.zeros((0, 0), np.float32),
        views=none,
        anchor=none,
        anchor_pixels=np.zeros((0, 2)),
        anchor_depth_m=np.zeros(0),
        anchor_slopes=np.zeros((0, 2)),
    )
    return LocalMap((), landmarks, next_serial, next_id, noise=noise, first_serial=next_serial)


def visibility(keyframes: tuple[Keyframe, ...]) -> tuple[Indices, Mask]:
    """The binary mask M[j, i]: landmark j is seen by keyframe i (thesis 4.4).

    Returns:
        (L,) ascending landmark ids and (L, K) mask.
    """
    ids = np.unique(np.concatenate([keyframe.ids for keyframe in keyframes]))
    mask = np.stack([np.isin(ids, keyframe.ids) for keyframe in keyframes], axis=1)
    return ids, mask
