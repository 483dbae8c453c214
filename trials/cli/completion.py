"""Values that the shell completes: names of scenes, disturbances, estimators and settings."""

from collections.abc import Callable, Iterable
from pkgutil import resolve_name

Words = Callable[[], Iterable[str]]
Completion = Callable[[str], list[str]]


def one_of(words: Words) -> Completion:
    """Complete one word of those that a function returns, which is called when the shell asks."""

    def complete(incomplete: str) -> list[str]:
        return [x for x in words() if x.startswith(incomplete)]

    return complete


def several_of(words: Words) -> Completion:
    """Complete the last of words that are separated by commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + x for x in one_of(words)(last)]

    return complete


def _scenes() -> Iterable[str]:
    from scenes import SCENES

    return SCENES


def _cameras() -> Iterable[str]:
    from sim.camera_names import CAMERAS

    return CAMERAS


def _disturbances() -> Iterable[str]:
    from sim.disturbances import DISTURBANCES

    return DISTURBANCES


def _estimators() -> Iterable[str]:
    from trials.estimators.choice import ESTIMATORS
    from trials.estimators.systems.environments import SYSTEMS

    return [*ESTIMATORS, *SYSTEMS]


BY_PARAMETER = {
    "scene": several_of(_scenes),
    "scenes": several_of(lambda: [*_scenes(), "all"]),
    "camera": one_of(_cameras),
    "disturb": several_of(_disturbances),
    "estimator": several_of(_estimators),
}
"""Name of a parameter of a command to its completion."""


MODELS = {"recording": "sim.settings:RecordSettings", "estimator": "vo.config:OdometrySettings"}
"""Kind of settings to its model."""


def keys_of(kind: str) -> Completion:
    """Complete a key of a kind of settings, followed by an equals sign."""

    def keys() -> list[str]:
        from vo.contract.settings import keys

        return [f"{x}=" for x in keys(resolve_name(MODELS[kind]))]

    return one_of(keys)
