"""Systems by others, to compare with; each runs in an environment of its own, if in another one.

None is a dependency. `driftyard systems list` and `driftyard systems install`.
"""
