"""The simulated world of a trial: scene, physics, sensors, free space and moving obstacles."""
