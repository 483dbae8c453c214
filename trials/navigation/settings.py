"""Settings of the navigator."""

from pydantic import Field

from trials.navigation.occupancy_grid import OccupancySettings
from vo.contract.settings import Settings


class NavigatorSettings(Settings):
    """Settings of the navigator."""

    occupancy: OccupancySettings = OccupancySettings(
        max_depth_m=3.5, hit_log_odds=0.5, occupied_log_odds=1.2, half_life_s=30.0
    )
    """An obstacle is occupied after three observations at a short distance: block matching yields
    many false ones, and the smear of a distant one closes an aisle until it has faded."""
    min_speckle_px: int = Field(default=60, ge=0)
    """Size of a region of similar disparity that is not noise, px."""
    radius_m: float = Field(default=0.35, gt=0)
    """Radius of the rover around its axle, m."""
    cell_m: float = Field(default=0.1, gt=0)
    """Side of a cell of the grid, m."""
    border_m: float = Field(default=8.0, gt=0)
    """Extent of the grid beyond start and goal, m."""
    initial_turn_deg: float = Field(default=360.0, ge=0, le=720)
    """Turn on the spot before leaving, since cameras see only ahead, deg."""
    replan_period_s: float = Field(default=0.2, gt=0)
    """Time between two plans, s."""
    lookahead_m: float = Field(default=0.7, gt=0)
    """Distance of the target along the path, m."""
    stop_distance_m: float = Field(default=1.0, gt=0)
    """Distance before an obstacle on a path that is kept, m."""
    arrival_radius_m: float = Field(default=0.08, gt=0)
    """Distance from the goal at which the rover stops, m."""
    min_progress_m: float = Field(default=0.1, gt=0)
    """Displacement that counts as progress, m."""
    stuck_timeout_s: float = Field(default=7.0, gt=0)
    """Time without progress before backing off, s."""
    back_off_duration_s: float = Field(default=1.5, gt=0)
    """Duration of backing off, s."""
    back_off_speed_mps: float = Field(default=0.15, gt=0)
    """Speed of backing off, m/s."""
    forget_radius_m: float = Field(default=1.0, gt=0)
    """Radius within which backing off weakens the grid, m."""
    forget_factor: float = Field(default=0.5, ge=0, le=1)
    """Factor on the log odds within that radius."""
    unknown_cost: float = Field(default=1.0, ge=0)
    """Additional cost of a cell that was never observed."""
    pivot_gain: float = Field(default=1.5, gt=0)
    """Turning speed over the angle on the spot, 1/s."""
