"""The stereo visual odometry estimator, and nothing else."""
