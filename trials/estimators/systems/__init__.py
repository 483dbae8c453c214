"""Systems by others, to compare with; each runs in an environment of its own, if in another one.

None is a dependency. `python -m trials.estimators.systems.install` lists and installs them.
"""
