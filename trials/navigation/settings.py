"""How careful the navigator is."""

from pydantic import Field

from trials.navigation.occupancy_grid import OccupancySettings
from vo.contract.settings import Settings


class NavigatorSettings(Settings):
    """How careful the navigator is."""

    occupancy: OccupancySettings = OccupancySettings(
        farthest_m=3.5, hit=0.5, occupied=1.2, half_life_s=30.0
    )
    """An obstacle must be seen three times, and not from afar: block matching sees many that are
    not there, and a smear of distant ones closes an aisle until it is forgotten."""
    speckle_px: int = Field(default=60, ge=0, description="of alike disparities, fewer are wrong")
    radius_m: float = Field(default=0.35, gt=0, description="of the rover, about its axle")
    cell_m: float = Field(default=0.1, gt=0, description="of the grid")
    around_m: float = Field(default=8.0, gt=0, description="of the grid, beyond start and goal")
    look_around_deg: float = Field(
        default=360.0, ge=0, le=720, description="turn before leaving: cameras see ahead alone"
    )
    replan_s: float = Field(default=0.2, gt=0, description="between two looks at the way")
    ahead_m: float = Field(default=0.7, gt=0, description="along the way to what is headed for")
    stop_m: float = Field(default=1.0, gt=0, description="before what blocks a way that stays")
    arrived_m: float = Field(default=0.08, gt=0, description="from the goal, to stop")
    progress_m: float = Field(default=0.1, gt=0, description="that counts as such")
    patience_s: float = Field(default=7.0, gt=0, description="without progress, to back off")
    back_off_s: float = Field(default=1.5, gt=0)
    back_off_mps: float = Field(default=0.15, gt=0)
    doubt_m: float = Field(default=1.0, gt=0, description="about the rover, on backing off")
    doubt: float = Field(default=0.5, ge=0, le=1, description="what is left there of log odds")
    unknown_cost: float = Field(default=1.0, ge=0, description="more, where nothing was seen")
    pivot_gain: float = Field(default=1.5, gt=0, description="turning speed by angle")
