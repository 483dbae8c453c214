"""Plug-in estimators: classes that are imported, and programs that are executed."""

from vo.contract.errors import DriftyardError


class PluginError(DriftyardError):
    """A plug-in estimator fails, or its result cannot be used."""


class WorkerEndedError(PluginError):
    """The process of an estimator has ended or hangs; it will not estimate further frames."""
