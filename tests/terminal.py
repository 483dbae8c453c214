"""The command line as a user calls it: in this process, or in one of its own."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import IO
from unittest.mock import patch

import cv2

from trials.cli.main import main

ROOT = Path(__file__).resolve().parents[1]


def driftyard(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `driftyard` with words in a folder, without a new interpreter.

    Everything that is written to the terminal is captured, by libraries in C as well. The process
    is left as it was: folder, environment, module path, threads of OpenCV, and no module of the
    folder stays loaded.
    """
    words = ("driftyard", *map(str, words))
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        with ExitStack() as stack:
            stack.enter_context(_in_folder(cwd))
            stack.enter_context(patch.object(sys, "argv", list(words)))
            for number, file, redirect in ((1, out, redirect_stdout), (2, err, redirect_stderr)):
                stack.enter_context(_descriptor(number, file))
                stack.enter_context(redirect(file))
            status = _status_of_main()
        said = []
        for file in (out, err):
            file.seek(0)
            said.append(file.read())
    return subprocess.CompletedProcess(words, status, *said)


def driftyard_process(
    *words: object, cwd: Path, timeout_s: float = 120
) -> subprocess.CompletedProcess[str]:
    """Run `driftyard` with words in a folder, in a process of its own."""
    command = [sys.executable, "-m", "trials.cli", *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command,
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def _status_of_main() -> int:
    try:
        main()
    except SystemExit as exit:
        if isinstance(exit.code, str):
            print(exit.code, file=sys.stderr)
        return exit.code if isinstance(exit.code, int) else int(exit.code is not None)
    return 0


@contextmanager
def _in_folder(cwd: Path) -> Iterator[None]:
    before, path, modules, threads = Path.cwd(), [*sys.path], {*sys.modules}, cv2.getNumThreads()
    os.chdir(cwd)
    try:
        with patch.dict(os.environ):
            yield
    finally:
        for name in {*sys.modules} - modules:
            file = getattr(sys.modules[name], "__file__", None)
            if file and Path(file).resolve().is_relative_to(cwd.resolve()):
                del sys.modules[name]
        os.chdir(before)
        sys.path[:] = path
        cv2.setNumThreads(threads)


@contextmanager
def _descriptor(number: int, file: IO[str]) -> Iterator[None]:
    """Let a file descriptor of the process lead to a file."""
    kept = os.dup(number)
    os.dup2(file.fileno(), number)
    try:
        yield
    finally:
        file.flush()
        os.dup2(kept, number)
        os.close(kept)
