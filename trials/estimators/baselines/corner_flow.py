"""Baseline: corners, Lucas–Kanade flow between frames and across the pair, PnP; frame to frame."""

from typing import ClassVar, cast

import cv2
import numpy as np
from pydantic import Field

from vo.contract import se3
from vo.contract.arrays import Array, Image, Mask
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, Observations, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.contract.settings import Settings


class CornerFlowSettings(Settings):
    """Settings of the baseline."""

    renamed: ClassVar = {"trials": "max_hypotheses", "spacing_px": "min_distance_px"}

    max_corners: int = Field(default=800, ge=4)
    """Number of corners detected in a frame."""
    quality: float = Field(default=0.01, gt=0, lt=1)
    """Smallest response of a corner, relative to the largest (Shi–Tomasi)."""
    min_distance_px: float = Field(default=10.0, ge=1)
    """Smallest distance of two corners."""
    window_px: int = Field(default=15, ge=5)
    """Side of the Lucas–Kanade window."""
    levels: int = Field(default=4, ge=0)
    """Pyramid levels above the full image."""
    round_trip_px: float = Field(default=0.5, gt=0)
    """Largest distance of a corner from its start when it is tracked forth and back."""
    row_px: float = Field(default=1.0, gt=0)
    """Largest difference of the rows of a corner in the left and right image."""
    min_disparity_px: float = Field(default=1.0, gt=0)
    """Smallest disparity of corners that are used."""
    inlier_px: float = Field(default=1.0, gt=0)
    """Largest reprojection error of an inlier of RANSAC."""
    max_hypotheses: int = Field(default=300, ge=1)
    """Number of hypotheses of RANSAC."""
    min_inliers: int = Field(default=12, ge=6)
    """Number of inliers below which a frame is lost."""
    seed: int = Field(default=0, ge=0)
    """Random seed of OpenCV, set before every RANSAC."""


class CornerFlow:
    """Estimator that keeps only the previous frame."""

    def __init__(self, rig: StereoRig, settings: CornerFlowSettings | None = None) -> None:
        self.rig = rig
        self.settings = settings or CornerFlowSettings()
        self._T_odom_cam = np.eye(4)
        self._previous: StereoFrame | None = None
        self._landmarks = 0

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the motion since the previous frame; never raises on image content."""
        s, previous, clock = self.settings, self._previous, Clock()
        self._previous = frame
        if previous is None:
            return Estimate(frame.timestamp_ns, Status.START, self._T_odom_cam)

        with clock("corners"):  # of the previous left image (Shi & Tomasi 1994)
            corners = self._detect(previous.left)
        with clock("stereo"):  # Lucas–Kanade there and back (Bouguet 2000)
            right, seen = self._track(previous.left, previous.right, corners)
            disparity_px = corners[:, 0] - right[:, 0]
            seen &= np.abs(corners[:, 1] - right[:, 1]) <= s.row_px
            seen &= disparity_px >= s.min_disparity_px
            corners, disparity_px = corners[seen], disparity_px[seen]
        with clock("flow"):  # the same in time
            moved, kept = self._track(previous.left, frame.left, corners)
            points_prev = self.rig.triangulate(corners[kept], disparity_px[kept])
        with clock("pose"):  # RANSAC PnP, then Levenberg–Marquardt on the inliers
            T_cam_prev, inlier = self._solve(points_prev, moved[kept])

        counts = {"corners": len(seen), "stereo": len(kept), "flow": len(inlier)}
        counts["inliers"] = int(inlier.sum())
        ids = self._landmarks + np.arange(len(inlier))
        self._landmarks += len(inlier)
        if T_cam_prev is None:
            self._previous = None
            unknown = np.full(len(inlier), np.nan)
            observed = Observations(ids, moved[kept], unknown, inlier)
            reason = f"{counts['inliers']} inliers of {len(inlier)} tracks, need {s.min_inliers}"
            return Estimate(
                frame.timestamp_ns, Status.LOST, None, reason, counts, clock.ms, observed
            )
        self._T_odom_cam = self._T_odom_cam @ se3.inverse(T_cam_prev)
        expected_px = self.rig.project(se3.transform(T_cam_prev, points_prev))[:, 2]
        observed = Observations(ids, moved[kept], expected_px, inlier)
        return Estimate(
            frame.timestamp_ns, Status.TRACKED, self._T_odom_cam, "", counts, clock.ms, observed
        )

    def _detect(self, image: Image) -> Array:
        """Return (N, 2) float32 corners (u, v), N may be 0."""
        s = self.settings
        corners = cast(
            "Array | None",
            cv2.goodFeaturesToTrack(image, s.max_corners, s.quality, s.min_distance_px),
        )
        return np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)

    def _track(self, a: Image, b: Image, pixels_a: Array) -> tuple[Array, Mask]:
        """Track (N, 2) pixels from image a to b; the mask marks those that return."""
        if len(pixels_a) == 0:
            return pixels_a, np.zeros(0, dtype=bool)
        s = self.settings
        window, guess = (s.window_px, s.window_px), np.empty_like(pixels_a)  # guess: unused output
        pixels_b, found, _ = cv2.calcOpticalFlowPyrLK(
            a, b, pixels_a, guess, winSize=window, maxLevel=s.levels
        )
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(
            b, a, pixels_b, guess.copy(), winSize=window, maxLevel=s.levels
        )
        kept = (found.ravel() == 1) & (found_back.ravel() == 1)
        return pixels_b, kept & (np.linalg.norm(back - pixels_a, axis=1) <= s.round_trip_px)

    def _solve(self, points_prev: Array, pixels: Array) -> tuple[Array | None, Mask]:
        """Return T_cam_prev (4, 4), or None, and the inliers (N,) of (N, 3) m to (N, 2) px."""
        s, K = self.settings, self.rig.K
        inlier = np.zeros(len(pixels), dtype=bool)
        if len(pixels) < s.min_inliers:
            return None, inlier
        cv2.setRNGSeed(s.seed)
        points, pixels = points_prev.astype(np.float64), pixels.astype(np.float64)
        found, rotation, t, chosen = cv2.solvePnPRansac(
            points, pixels, K, None, iterationsCount=s.max_hypotheses, reprojectionError=s.inlier_px
        )
        if not found or len(chosen) < s.min_inliers:
            return None, inlier
        inlier[np.ravel(chosen).astype(np.int64)] = True
        rotation, t = cv2.solvePnPRefineLM(points[inlier], pixels[inlier], K, None, rotation, t)
        T_cam_prev = se3.pose(cv2.Rodrigues(rotation)[0], np.ravel(t))
        return (T_cam_prev if np.isfinite(T_cam_prev).all() else None), inlier
