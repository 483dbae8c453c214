"""The packages of driftyard."""

PACKAGES = ("driftyard", "scenes", "sim", "vo", "trials")


def is_own(module: str) -> bool:
    """Whether a module, by its full name, is one of driftyard's."""
    return module.partition(".")[0] in PACKAGES
