"""The physical world: rover, terrain, route and drive."""
