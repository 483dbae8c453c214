"""Comparison of odometry systems over scenes, with repeated runs; `driftyard systems compare`."""
