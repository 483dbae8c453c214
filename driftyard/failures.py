"""Failures of the machine, such as a full disk or a missing OpenGL, as errors of one family."""

from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from functools import wraps
from typing import ParamSpec, TypeVar

from sim.graphics import GraphicsError, explain_fault, is_graphics_fault
from vo.contract.errors import DriftyardError

P = ParamSpec("P")
R = TypeVar("R")


def as_driftyard_error(error: Exception) -> DriftyardError | None:
    """Return the error of the family that states a failure in one line; None for a defect."""
    if isinstance(error, DriftyardError):
        return error
    if isinstance(error, OSError) and error.filename is not None:
        return DriftyardError(f"{error.filename}: {error.strerror}")
    if isinstance(error, BrokenProcessPool):
        return DriftyardError("a worker process was killed (out of memory?); run the command again")
    if is_graphics_fault(error):
        return GraphicsError(f"no OpenGL: {explain_fault(error)}")
    return None


def in_one_family(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function raise failures as `as_driftyard_error` states them."""

    @wraps(function)
    def call(*args: P.args, **words: P.kwargs) -> R:
        try:
            return function(*args, **words)
        except Exception as error:
            stated = as_driftyard_error(error)
            if stated is None or stated is error:
                raise
            raise stated from error

    return call
