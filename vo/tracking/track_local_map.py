"""Where a view lies in the map: matched about a guess, oriented, refined (thesis 3.2-3.4)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vo.bundle_adjustment.adjust import Pose
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Observations
from vo.contract.rig import StereoRig
from vo.features.adaptive_windows import adapt_to_blur
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.map.state import Journey
from vo.tracking.appearance import eyes_look_swapped
from vo.tracking.association import Matches, expected_at, find_matches, find_more, in_sight
from vo.tracking.circular_check import consistent
from vo.tracking.context import Gear
from vo.tracking.klt import follow
from vo.tracking.landmark_prior import believed
from vo.tracking.pose_refinement import agreeing, orient, refine_pose
from vo.tracking.replacement import replace_inliers, replace_matches
from vo.tracking.rotation_prior import find_turn

SOUND = 0.85
"""Share of the templates found that agree with a pose, unless they are blurred or misled."""
CONFIRMING = 0.5
"""Share of the landmarks followed that must agree with a pose by templates."""
FLOW_WORTH = 0.5
"""Of a landmark followed from the frame before, beside one found by its template."""

ONE_EYED = 0.7
"""Share of inliers without disparity above which the right image shows something else."""


@dataclass(frozen=True)
class Location:
    """A view's pose, and what it rests on.

    Attributes:
        view: The view, with the settings that it is met with from here on.
        pose: In the odometry frame.
        matches: Landmarks that were found, inliers or not.
        inliers: Those that agree with the pose.
        followed: Whether they come from the frame before, not from templates.
        counts: Items that survived each stage, and iterations.
    """

    view: View
    pose: Pose
    matches: Matches
    inliers: Matches
    followed: bool
    counts: dict[str, int]

    def observations(self) -> Observations:
        """Tell others what was seen."""
        found = self.matches
        agree = np.isin(found.ids, self.inliers.ids)
        return Observations(found.ids, found.pixels, found.measured[:, 2], agree)


@dataclass(frozen=True)
class _Search:
    """Landmarks that were sought in a view about a guessed pose (4, 4)."""

    view: View
    matches: Matches
    T_guess: Array
    followed: bool = False


def locate(
    here: Journey, view: View, gear: Gear, counts: dict[str, int], clock: Clock
) -> Location | None:
    """Search where the expected motion leads, and elsewhere as long as that does not convince.

    None if too few landmarks agree with any pose.

    Args:
        here: Its map, last pose and motion.
        view: The new frame.
        gear: Calibration, hooks, samples.
        counts: Receives those of the search that counts, or else came nearest.
        clock: Times the stages.
    """
    best: Location | None = None
    tallies = []
    for search in _searches(here, view, gear, clock):
        tallies.append({"matches": 0, "inliers": 0})
        found = _locate_by(search, here, gear, tallies[-1], clock)
        if found and best and _confirms(found, best, gear.rig):
            break
        best = max(found, best, key=_agreement)
        if best and _convinces(best, here.map, gear.rig):
            break
    counts.update(best.counts if best else max(tallies, key=lambda tally: tally["inliers"]))
    if best is None:
        return None
    blind = np.isnan(best.inliers.measured[:, 2]).mean() > ONE_EYED
    return None if blind and eyes_look_swapped(view, view.settings) else best


def _agreement(found: Location | None) -> float:
    if found is None:
        return 0.0
    return len(found.inliers) * (FLOW_WORTH if found.followed else 1.0)


def _confirms(flow: Location, best: Location, rig: StereoRig) -> bool:
    """Whether flow says the same as sound templates, which bend with the surface and are exact."""
    if not flow.followed or len(best.inliers) < SOUND * len(best.matches):
        return False
    same = agreeing(best.pose.T_world_cam, flow.inliers, rig, flow.view.settings.motion)
    return len(same) >= CONFIRMING * len(flow.inliers)


def _convinces(found: Location, local_map: LocalMap, rig: StereoRig) -> bool:
    """Whether so many landmarks agree that it is no use to look elsewhere."""
    expected = expected_at(local_map.landmarks, found.pose.T_world_cam, rig)
    visible = in_sight(expected, found.view.frame.left)
    return len(found.inliers) >= found.view.settings.matching.min_inlier_ratio * visible.sum()


def _searches(here: Journey, view: View, gear: Gear, clock: Clock) -> Iterator[_Search]:
    """Ways to find landmarks in a view, each tried if those before do not convince.

    First as expected; then as the images have turned; then, as if it were blurred, by flow from the
    frame before; at last anywhere near.
    """
    s, rig, local_map = view.settings, gear.rig, here.map

    def about(T_guess: Array, reach_px: float) -> _Search:
        with clock("matching"):  # marriage by ZNCC, sub-pixel alignment (3.2)
            matches = find_matches(local_map, view, T_guess, reach_px, rig, s)
        return _Search(view, matches, T_guess)

    steady = s.matching.motion_model == "constant_velocity" and not here.wheels_rest(view)
    expected = here.T_odom_cam @ (here.T_before_now if steady else np.eye(4))
    expected = gear.hooks.predicted(view.frame, here.last_ns, here.T_odom_cam, expected)
    yield about(expected, s.matching.search_radius_px)
    if s.matching.min_inlier_ratio and here.before:
        with clock("turn"):
            step = se3.inverse(here.T_odom_cam) @ expected
            step[:3, :3] = find_turn(here.before.left, view.frame.left, rig, step[:3, :3])
            turned = here.T_odom_cam @ step
        yield about(turned, s.matching.search_radius_px)
        blurred = replace(view, settings=adapt_to_blur(s))
        with clock("following"):
            followed = follow(here.before, local_map, blurred, turned, rig)
        yield _Search(blurred, followed, turned, followed=True)
    yield about(here.T_odom_cam, s.matching.max_search_radius_px)


def _locate_by(
    search: _Search, here: Journey, gear: Gear, counts: dict[str, int], clock: Clock
) -> Location | None:
    view, matches, T_guess = search.view, search.matches, search.T_guess
    s, rig, hooks, local_map = view.settings, gear.rig, gear.hooks, here.map
    with clock("matching"):
        matches = replace_matches(hooks, _confirmed(matches, here, view), local_map, view, s)
        counts["matches"] = len(matches)
    with clock("motion"):  # orientation under RANSAC (3.3)
        weights = believed(matches, local_map, here.strikes, T_guess, rig, s)
        consensus = orient(matches, T_guess, weights, rig, s, gear.rng)
        if consensus is None:
            return None
        agreed = replace_inliers(hooks, view, matches, matches.select(consensus.inliers))
        counts["consensus"] = counts["inliers"] = len(agreed)
        if len(agreed) < s.motion.min_inliers:
            return None
    with clock("motion refinement"):  # at every frame (3.4)
        pose = refine_pose(consensus.T_odom_cam, agreed, rig, s)
        counts["motion iterations"] = pose.iterations
    if s.matching.guided and not search.followed:
        with clock("guided matching"):  # the other landmarks, where the pose puts them (F5)
            matches = find_more(local_map, view, pose.T_world_cam, matches, rig, s)
            matches = replace_matches(hooks, _confirmed(matches, here, view), local_map, view, s)
            agreed = agreeing(pose.T_world_cam, matches, rig, s.motion)
            agreed = replace_inliers(hooks, view, matches, agreed)
            pose = refine_pose(pose.T_world_cam, agreed, rig, s)
            counts["motion iterations"] += pose.iterations
    inliers = agreeing(pose.T_world_cam, matches, rig, s.motion)
    inliers = replace_inliers(hooks, view, matches, inliers)
    counts["found"], counts["inliers"] = len(matches), len(inliers)
    if len(inliers) < s.motion.min_inliers:
        return None
    return Location(view, pose, matches, inliers, search.followed, counts)


def _confirmed(matches: Matches, here: Journey, view: View) -> Matches:
    """Matches that the frame before confirms, if it is asked (F4)."""
    s = view.settings.matching
    if not s.circular_check or here.before is None:
        return matches
    left = view.frame.left
    return matches.select(consistent(matches, here.map.landmarks, here.before, left, s.align_px))
