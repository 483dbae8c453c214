"""Path planning, mapping and control of the rover."""
