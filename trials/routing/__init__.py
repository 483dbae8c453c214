"""Routing an urgent vehicle over roads whose delays change during the drive."""
