"""Plug-in estimators: classes that are imported, and programs that are executed."""

from vo.contract.errors import DriftyardError


class PluginError(DriftyardError):
    """A plug-in estimator fails, or its result cannot be used."""
