"""The moving world: carrier, terrain, route, physics and random streams."""
