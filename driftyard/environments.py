"""Registration of the environments with Gymnasium, which takes longer to import than driftyard."""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

REGISTRY = "gymnasium.envs.registration"


class RegistryFinder(MetaPathFinder):
    """Finder on `sys.meta_path` that lets the registry register our environments once it is loaded.

    The finders after it find the module.
    """

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the registry, and nothing else."""
        if name != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            load(module)
            import_module("trials.gym")

        vars(spec.loader)["exec_module"] = load_and_register
        return spec


def register_environments() -> None:
    """Register the environments now, or as soon as Gymnasium is imported."""
    if REGISTRY in sys.modules:
        import_module("trials.gym")
    else:
        sys.meta_path.insert(0, RegistryFinder())
