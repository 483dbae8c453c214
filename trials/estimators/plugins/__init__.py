"""Estimators that others wrote: classes that are loaded here, programs that run elsewhere."""

from vo.contract.errors import DriftyardError


class PluginError(DriftyardError):
    """An estimator from outside fails, or gives what cannot be used."""
