"""Bundle adjustment of the map after a new keyframe, by `refinement.mode`."""

from collections.abc import Callable, Mapping

from vo.config import RefinementSettings
from vo.contract.rig import StereoRig
from vo.map.local_map import LocalMap
from vo.mapping.incremental_adjustment import IncrementalAdjustment
from vo.mapping.window_adjustment import adjust_window

Adjustment = Callable[[LocalMap], tuple[LocalMap, int]]
"""A map to the adjusted one and the iterations that it took, 0 where nothing was adjusted."""


def _none(rig: StereoRig, settings: RefinementSettings) -> Adjustment:
    return lambda local_map: (local_map, 0)


def _window(rig: StereoRig, settings: RefinementSettings) -> Adjustment:
    return lambda local_map: adjust_window(local_map, rig, settings)


ADJUSTMENTS: Mapping[str, Callable[[StereoRig, RefinementSettings], Adjustment]] = {
    "none": _none,
    "motion": _none,
    "window": _window,
    "fixed_lag": IncrementalAdjustment,
}
