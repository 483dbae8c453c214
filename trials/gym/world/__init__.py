"""The world of a trial: simulation, free space, and obstacles that move."""
