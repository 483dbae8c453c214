"""Limits that keep the code readable: sizes, cycles and repetition (CONTRIBUTING.md)."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("driftyard", "scenes", "sim", "vo", "trials")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
MAX_MODULE_LINES, MAX_FUNCTION_LINES, MAX_PARAMETERS, MAX_REPEATED_LINES = 300, 60, 8, 8
MAX_TEST_NAME_LETTERS = 60


def functions(path):
    """All functions of a file, methods and inner ones included."""
    nodes = ast.walk(ast.parse(path.read_text("utf-8")))
    return [x for x in nodes if isinstance(x, ast.FunctionDef | ast.AsyncFunctionDef)]


@cache
def plain_functions(path):
    """Functions of a file that are not compiled to machine code."""
    found = []
    for node in functions(path):
        decorators = {ast.unparse(x).split("(")[0] for x in node.decorator_list}
        if not decorators & {"compiled", "njit", "numba.njit"}:
            found.append(node)
    return found


def name_of(path, node):
    return f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"


def test_modules_are_short():
    lines = {str(x.relative_to(ROOT)): len(x.read_text("utf-8").splitlines()) for x in FILES}
    assert {x: n for x, n in lines.items() if n > MAX_MODULE_LINES} == {}


def test_functions_are_short():
    sizes = {
        name_of(path, x): x.end_lineno - x.lineno + 1
        for path in FILES
        for x in plain_functions(path)
    }
    assert {x: n for x, n in sizes.items() if n > MAX_FUNCTION_LINES} == {}


def test_functions_have_few_parameters():
    counts = {}
    for path in FILES:
        for node in plain_functions(path):
            names = [x.arg for x in (*node.args.posonlyargs, *node.args.args)]
            own = names[1:] if names[:1] in (["self"], ["cls"]) else names
            counts[name_of(path, node)] = len(own) + len(node.args.kwonlyargs)
    assert {x: n for x, n in counts.items() if n > MAX_PARAMETERS} == {}


def test_imports_have_no_cycle():
    graph = grimp.build_graph(*PACKAGES)
    imports = {x: graph.find_modules_directly_imported_by(x) for x in graph.modules}
    done, path = set(), []

    def visit(module):
        if module in path:
            pytest.fail(" -> ".join([*path[path.index(module) :], module]))
        if module in done:
            return
        path.append(module)
        for other in sorted(imports[module]):
            visit(other)
        path.pop()
        done.add(module)

    for module in sorted(imports):
        visit(module)


def test_lines_are_not_repeated():
    """No run of more than eight lines stands twice; blank lines, comments and imports aside."""
    size = MAX_REPEATED_LINES + 1
    found = defaultdict(list)
    for path in FILES:
        text = path.read_text("utf-8").splitlines()
        lines = [(k, x.strip()) for k, x in enumerate(text, 1)]
        plain = [
            (k, x) for k, x in lines if len(x) > 1 and not x.startswith(("#", "from ", "import "))
        ]
        for i in range(len(plain) - size + 1):
            run = tuple(x for _, x in plain[i : i + size])
            found[run].append(f"{path.relative_to(ROOT)}:{plain[i][0]}")
    assert [places for places in found.values() if len(places) > 1] == []


def test_names_of_tests_are_short():
    names = [name_of(x, f) for x in TESTS for f in functions(x) if f.name.startswith("test_")]
    letters = {x: len(x.split()[-1]) for x in names}
    assert {x: n for x, n in letters.items() if n > MAX_TEST_NAME_LETTERS} == {}
