"""Compilation of numerical loops to machine code, which is kept between runs.

Numba keeps machine code with a digest of the file that a function stands in. That overlooks a
callee in another file, and compiles a whole file anew for a comment. Here the digest is that of
the function itself: bytecode, options, constants and, in turn, all compiled functions that it
calls. A change therefore recompiles exactly the functions that it reaches, and nothing is deleted.

Machine code lies in `__pycache__` beside the source. Where that folder is read-only, what it holds
is used, and new code goes to a folder of the user ($XDG_CACHE_HOME/driftyard). $NUMBA_CACHE_DIR
names another folder instead of both.
"""

import hashlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])

NOTICE = "driftyard: compiling machine code (once; about 30 s for all of the estimator)"

_MODULES = ("numpy", "math", "numba")
"""Modules whose content changes with their release only."""


class _Distinct(Compiler):
    """Compiles functions whose arguments share no memory: vectors are loaded and stored at will."""

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


def compiled(distinct: bool = False, **options: Any) -> Callable[[Function], Function]:
    """Compile a function to machine code at its first call, by `numba.njit`'s options; keep it.

    Arrays that are `distinct` share no memory with each other in any call.
    """
    njit: Any = numba.njit  # its types know neither this option nor options in a dictionary
    if distinct:
        options["pipeline_class"] = _Distinct

    def decorate(function: Function) -> Function:
        dispatcher = njit(no_cfunc_wrapper=True, error_model="numpy", **options)(function)
        dispatcher._cache = _Cache(dispatcher)
        return dispatcher

    return decorate


def fingerprint(dispatcher: Dispatcher) -> str:
    """Compute the digest of everything that a function's machine code is made from.

    Raises:
        TypeError: If it uses a global value that is neither a constant nor a compiled function.
    """
    digest = hashlib.sha256()
    pending, reached = [dispatcher], {id(dispatcher)}
    while pending:
        current = pending.pop()
        function = current.py_func
        digest.update(_text(function.__qualname__).encode())
        pipeline = current._compiler.pipeline_class  # type: ignore[attr-defined]
        digest.update(_text((current.targetoptions, pipeline, function.__defaults__)).encode())
        tuples = [x for x in function.__annotations__.values() if hasattr(x, "_fields")]
        digest.update(_text(tuples).encode())
        for code in _codes(function.__code__):
            digest.update(_code_text(code, function.__doc__).encode())
            for name in sorted(set(code.co_names) & function.__globals__.keys()):
                value = function.__globals__[name]
                for callee in getattr(value, "implementations", (value,)):  # of an overload
                    if not isinstance(callee, Dispatcher):
                        digest.update(f"{name}={_text(callee)};".encode())
                    elif id(callee) not in reached:
                        reached.add(id(callee))
                        pending.append(callee)
    return digest.hexdigest()


def is_kept(function: Callable[..., Any]) -> bool:
    """Tell whether machine code of a compiled function, as it is now, lies on the disk."""
    cache = function._cache  # type: ignore[attr-defined]
    return any(_load(store._load_index) for store in cache._opened())


def _load(read: Callable[..., Any], *arguments: object) -> Any:
    """Read from a store; None if its folder cannot be read."""
    try:
        return read(*arguments)
    except OSError:
        return None


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and those nested in it, as of generator expressions."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _code_text(code: CodeType, docstring: str | None) -> str:
    """Describe a code object without its line numbers and its docstring, the first constant."""
    constants = [x for x in code.co_consts if not isinstance(x, CodeType)]
    if constants and constants[0] == docstring:
        constants[0] = None
    return f"{code.co_code.hex()}{constants!r}{code.co_names}{code.co_varnames}"


def _text(value: object) -> str:
    """Describe a value that Numba turns into a constant; equal for equal values.

    Raises:
        TypeError: If it cannot be told whether the value changes from run to run.
    """
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        return repr(value)
    if isinstance(value, np.ndarray):
        data = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype}{value.shape}{data}"
    if isinstance(value, Mapping):
        return _text(sorted((_text(k), _text(v)) for k, v in value.items()))
    if isinstance(value, Set):
        return _text(sorted(map(_text, value)))
    if isinstance(value, ModuleType) and value.__name__.split(".")[0] in _MODULES:
        return value.__name__
    if isinstance(value, Sequence):
        return f"({','.join(map(_text, value))})"
    if isinstance(value, type | BuiltinFunctionType | FunctionType | np.ufunc):
        return f"{value.__name__}{getattr(value, '_fields', '')}"
    raise TypeError(f"a compiled function uses {value!r}: import constants and functions by name")


class _Codec(CompileResultCacheImpl):
    """Turns compiled functions into bytes and back; where these lie is decided by `_Cache`."""

    def __init__(self) -> None:
        pass


_CODEC = _Codec()


class _Store(IndexDataCacheFile):
    """Machine code of one function in one folder."""

    def _load_index(self) -> dict[Any, str]:
        """Load the index; none where it names types that this release no longer has."""
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}


class _Cache(FunctionCache):
    """Machine code of one function on the disk, one entry for each signature."""

    def __init__(self, dispatcher: Dispatcher) -> None:
        self._dispatcher, self._py_func = dispatcher, dispatcher.py_func
        self._stores: list[_Store] = []
        self.enable()

    @property
    def cache_path(self) -> str:
        """The folder that new code goes to first."""
        return str(_folders(Path(self._py_func.__code__.co_filename))[0])

    def flush(self) -> None:
        for store in self._opened():
            store.flush()

    def _opened(self) -> list[_Store]:
        if not self._stores:  # not before the first call: callees may stand further down
            source = Path(self._py_func.__code__.co_filename)
            name = f"{source.stem}.{self._py_func.__qualname__}.{sys.implementation.cache_tag}"
            stamp = fingerprint(self._dispatcher)
            self._stores = [_Store(str(x), name, stamp) for x in _folders(source)]
        return self._stores

    def _load_overload(self, sig: object, target_context: Any) -> Any:
        key = self._index_key(sig, target_context.codegen())
        for store in self._opened():
            data = _load(store.load, key)
            if data is not None:
                return _CODEC.rebuild(target_context, data)
        return None

    def _save_overload(self, sig: object, data: Any) -> None:
        if data.library.has_dynamic_globals:  # it holds addresses of this process
            return
        key = self._index_key(sig, data.codegen)
        source = Path(self._py_func.__code__.co_filename)
        for folder, store in zip(_folders(source), self._opened(), strict=True):
            try:
                folder.mkdir(parents=True, exist_ok=True)
                store.save(key, _CODEC.reduce(data))
            except OSError:  # read-only, or full: the next folder
                continue
            return


def _folders(source: Path) -> list[Path]:
    """Folders for the machine code of a source file, in order."""
    apart = f"{source.parent.name}-{hashlib.sha256(str(source.parent).encode()).hexdigest()[:16]}"
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        return [Path(named) / apart]
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return [source.parent / "__pycache__", user / "driftyard" / apart]


class _Progress(event.Listener):
    """Says on standard error that functions of this project are being compiled."""

    def __init__(self) -> None:
        self.functions = 0

    def on_start(self, event: event.Event) -> None:
        """Print a notice with the first function, and on a terminal the name of each."""
        function = (event.data or {})["dispatcher"]
        if not isinstance(function._cache, _Cache):
            return
        self.functions += 1
        if self.functions == 1:
            print(NOTICE, file=sys.stderr, flush=True)
        if sys.stderr.isatty():
            name = f"{function.py_func.__module__}.{function.py_func.__name__}"
            print(f"\r\x1b[K{self.functions}: {name}", end="", file=sys.stderr, flush=True)

    def on_end(self, event: event.Event) -> None:
        """Clear the line of a terminal."""
        if isinstance((event.data or {})["dispatcher"]._cache, _Cache) and sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


event.register("numba:compile", _Progress())
