"""Views of the left camera, and the motion of what they show from one to any other."""

from dataclasses import dataclass

import numpy as np

from sim.labels.labels import NOTHING, covisibility, flow
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig


@dataclass(frozen=True)
class View:
    """What the left camera sees at one instant.

    Attributes:
        rig: True geometry of the camera.
        depth_m: (H, W) float32 planar depth; NaN for the sky and where a surface is seen through.
        surface_m: (H, W) float32, the same without these holes.
        numbers: (H, W) row of what is drawn in the tables that follow; -1 is the sky.
        body_of: Body that each moves with; 0 is the world.
        kind_of: Class of each, `Kind`; None if it is unknown.
        unpredicted: (H, W) whether it is unknown how the point moves; None if it is known of all.
        T_world_cam: (4, 4) left camera.
        T_world_bodies: (B, 4, 4) bodies.
    """

    rig: StereoRig
    depth_m: Array
    surface_m: Array
    numbers: Indices
    body_of: Indices
    kind_of: Array | None
    unpredicted: Mask | None
    T_world_cam: Array
    T_world_bodies: Array


def motions_between(now: View, then: View) -> Array:
    """Return the motion (B, 4, 4) of each body from the present camera axes to the others."""
    T_body_cam = se3.inverse(now.T_world_bodies) @ now.T_world_cam
    return se3.inverse(then.T_world_cam) @ then.T_world_bodies @ T_body_cam


def flow_between(now: View, then: View) -> Array:
    """Return (H, W, 3) float32 du and dv in pixels, and depth in metres, in another view.

    NaN where that is unknown, and for points behind the other camera; the depth of the sky is NaN.
    """
    bodies = now.body_of[now.numbers]
    return masked(
        now.unpredicted, flow(now.rig, now.depth_m, bodies, motions_between(now, then)), np.nan
    )


def covisibility_between(flow: Array, now: View, surface_then_m: Array) -> Array:
    """Return whether another view, of whose surfaces the depth (H, W) is given, shows each point.

    (H, W) uint8 of `Occlusion`; the flow is that of `flow_between`.
    """
    return masked(now.unpredicted, covisibility(flow, surface_then_m), NOTHING)


def masked(mask: Mask | None, label: Array, value: float) -> Array:
    """Replace a label by a value at the pixels of a mask, if there are any."""
    if mask is None or not mask.any():
        return label
    label = label.copy()
    label[mask] = value
    return label
