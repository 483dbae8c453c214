"""The local map, the frames that are tracked in it, and the state of the odometry."""
