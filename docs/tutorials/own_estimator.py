"""A custom estimator in the loop: python docs/tutorials/own_estimator.py [SCENE].

The class below matches corners from each frame to the next and solves for the motion; any class
with a method `track` is accepted (docs/plugins.md). The environment imports it by its name.
"""

import sys
from pathlib import Path

import cv2
import gymnasium
import numpy as np

from vo.contract.estimator import Estimate, Status


class CornerPnp:
    """Corners, their disparity, Lucas-Kanade flow, and PnP under RANSAC."""

    def __init__(self, rig):
        self.rig, self.T_odom_cam, self.before = rig, np.eye(4), None
        self.flow = {"winSize": (15, 15), "maxLevel": 3}

    def track(self, frame):
        """Return where the left camera is in the first left camera's frame."""
        if self.before is not None and (T_now_before := self._motion(frame)) is None:
            return Estimate(frame.timestamp_ns, Status.LOST, None, "too few corners")
        if self.before is not None:
            self.T_odom_cam = self.T_odom_cam @ np.linalg.inv(T_now_before)
        self.before = frame
        return Estimate(frame.timestamp_ns, Status.TRACKED, self.T_odom_cam)

    def _motion(self, frame):
        before = self.before
        corners = cv2.goodFeaturesToTrack(before.left, 300, 0.01, 8)
        if corners is None:
            return None
        right, ok_right, _ = cv2.calcOpticalFlowPyrLK(
            before.left, before.right, corners, None, **self.flow
        )
        now, ok_now, _ = cv2.calcOpticalFlowPyrLK(
            before.left, frame.left, corners, None, **self.flow
        )
        left, right, now = corners[:, 0], right[:, 0], now[:, 0]
        disparity = left[:, 0] - right[:, 0]
        good = (ok_right & ok_now).ravel().astype(bool) & (disparity > 1)
        good &= np.abs(left[:, 1] - right[:, 1]) < 1
        if good.sum() < 8:
            return None
        points = self.rig.triangulate(left[good].astype(float), disparity[good])
        found, turn, shift, _ = cv2.solvePnPRansac(
            points, now[good].astype(float), self.rig.K, None, reprojectionError=1.0
        )
        if not found:
            return None
        T_now_before = np.eye(4)
        T_now_before[:3, :3], T_now_before[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
        return T_now_before


def main(scene: str, steps: int) -> None:
    """Drive a gentle curve with three sources of localization and compare their errors."""
    for localization in (f"{Path(__file__).stem}:CornerPnp", "vo", "wheels"):
        env = gymnasium.make(
            "driftyard:driftyard/RoverNav-v0",
            scene=scene,
            localization=localization,
            observe=("goal",),
        )
        env.reset(seed=3)
        for _ in range(steps):
            *_, over, _, info = env.step(np.array([0.4, 0.2], np.float32))
            if over:
                break
        print(f"{localization:24} {100 * info['error_m']:6.2f} cm {info['error_deg']:6.2f} deg")
        env.close()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))  # where the estimator is imported from
    main(sys.argv[1] if len(sys.argv) > 1 else "office", int((sys.argv[2:] or [60])[0]))
