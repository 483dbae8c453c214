"""Code of README, pages and notebooks runs as it stands, in a small yard and with small images.

The blocks of a page run in order, in one namespace and one folder; shell blocks on the pages of
SHELL_PAGES only, since tests/unit/test_documented_commands.py checks the options of all.
"""

import re
import shutil
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from documented import NOTEBOOKS, PAGES, Block, blocks, commands
from gym_worlds import write_yard
from terminal import ROOT, driftyard

import driftyard as dy
from trials.cli.gate import EXIT
from vo.contract.remarks import Remark

pytestmark = pytest.mark.gl

SIZE = {"rig.width_px": 128, "rig.height_px": 96, "rig.rate_hz": 5, "render.samples": 0}
SMALL = {**SIZE, "drive.distance_m": 1.2, "drive.speed_mps": 0.6}
SMALLER = (
    (r'"(office|meadow)"', '"yard.xml"'),
    (r'"width_px": \d+, "height_px": \d+', '"width_px": 128, "height_px": 96'),
    (r'"rate_hz": \d+', '"rate_hz": 5'),
    (r'\{"drive.distance_m": \d+\}', repr(SMALL)),
    (r'"rig": {', '"render": {"samples": 0}, "rig": {'),
    (r"frames=20", "frames=4"),
    (r'"distance_m": 1.5, "speed_mps": 0.5', '"distance_m": 1.2, "speed_mps": 0.6'),
    (r'distance_m=\(2.0, 2.5\)', 'distance_m=(1.0, 1.5)'),
    (
        r'scene="(office|yard.xml)", localization="vo"\)',
        f'scene="yard.xml", settings={SIZE}, distance_m=(1.0, 1.5))',
    ),
)  # fmt: skip
"""What is replaced in Python, and by what."""
SHELL_PAGES = {"tasks.md", "own_scene.md"}
RUNNING = [
    page
    for page in [*PAGES, *NOTEBOOKS]
    if page.name in SHELL_PAGES or any(x.language == "python" for x in blocks(page))
]


@pytest.fixture(scope="module")
def made(tmp_path_factory, in_this_process) -> Path:
    """A folder with what pages take for granted: a recording, a trajectory, a class, a baseline."""
    folder = tmp_path_factory.mktemp("made")
    write_yard(folder)
    labels = {"labels.flow": True, "labels.segmentation": True, "labels.occlusion": True}
    ds = dy.record(folder / "yard.xml", folder / "data", settings=SMALL | labels)
    dy.run(ds, "corner_flow", folder / "theirs.txt")
    cells = blocks(ROOT / "docs/notebooks/own_estimator.ipynb")
    (folder / "my_vo.py").write_text(cells[0].text)
    page = blocks(ROOT / "docs/tutorials/own_scene.md")
    (folder / "hall.xml").write_text(next(x.text for x in page if x.file == "hall.xml"))
    gate = "driftyard gate update --baseline gate.json --estimator my_vo:MyOdometry --scenes office"
    run_command(gate.split(), folder)
    return folder


@pytest.mark.parametrize("page", RUNNING, ids=lambda page: str(page.relative_to(ROOT)))
def test_code_of_page_runs(page, made, tmp_path, monkeypatch):
    folder = shutil.copytree(made, tmp_path / "page")
    found = blocks(page)
    executed = "".join(x.text for x in found if is_run(x))
    if re.search(r'generate.*--out data\b|record\([^)]*"data"', executed):
        shutil.rmtree(folder / "data")
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    names: dict[str, object] = {}
    loaded = {*sys.modules}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Remark)
        for block in found:
            if is_run(block):
                run(block, names, folder)
    plt.close("all")
    for name in ({*sys.modules} - loaded) & {"my_vo", "worse_vo", "my_worlds"}:
        del sys.modules[name]


def is_run(block: Block) -> bool:
    """Whether a block is run here."""
    is_here = not block.not_run and (not block.needs or find_spec(block.needs) is not None)
    return is_here and (block.language != "sh" or block.page.name in SHELL_PAGES)


def run(block: Block, names: dict[str, object], folder: Path) -> None:
    """Run a block of Python, or a shell block on one of the pages; write one that is a file."""
    if block.file:
        (folder / block.file).write_text(block.text)
    elif block.language == "python":
        text = block.text
        for command in commands("\n".join(re.findall(r"^!(.*)$", text, re.MULTILINE))):
            run_command(command, folder)
        text = re.sub(r"^!.*$", "", text, flags=re.MULTILINE)
        for pattern, small in SMALLER:
            text = re.sub(pattern, small, text)
        place = str(block.page.relative_to(ROOT))
        exec(compile("\n" * (block.line - 1) + text, place, "exec"), names)
    elif block.language == "sh":
        for command in commands(block.text):
            if command[0] == "driftyard":
                run_command(command, folder)


def run_command(words: list[str], folder: Path) -> None:
    """Run a command with small images; a gate may end in any of its verdicts."""
    _, name, *rest = [re.sub("^office$|^office,.*", "yard.xml", x) for x in words]
    if name == "generate":
        small = (
            SIZE | {"drive.speed_mps": 0.6}
            if "hall.xml" in rest or "my_worlds:field" in rest
            else SMALL
        )
        rest += [x for key, value in small.items() for x in ("--set", f"{key}={value}")]
    if name == "gate" and rest[0] == "update":
        small = [x for key, value in SIZE.items() for x in ("--record", f"{key}={value}")]
        rest += ["--seeds", "1", "--distance", "1.2", *small]
    done = driftyard(name, *rest, cwd=folder)
    valid = EXIT.values() if rest[:1] == ["check"] else [0]
    assert done.returncode in valid, f"{' '.join(words)}: {done.stderr}"


def test_tasks_are_ten_and_short():
    sections = re.split(r"^## (?=\d)", (ROOT / "docs/tasks.md").read_text(), flags=re.MULTILINE)[1:]
    assert [int(x.partition(".")[0]) for x in sections] == list(range(1, 11))
    for section in sections:
        ((language, code),) = re.findall(
            r"^```(\w+)\n(.*?)^```$", section, re.DOTALL | re.MULTILINE
        )
        lines = [x for x in code.splitlines() if x.strip()]
        assert len(list(commands(code))) <= 2 if language == "sh" else len(lines) <= 10
