"""Truth of a recorded dataset beyond its labels: motion between any frames, boxes, geometry."""
