"""Many datasets while a worker is killed and disks are full.

Real processes, real signals, and a real file system without room: what was complete stays to the
byte, nothing half-written takes a final name, and the same command makes only what is missing.
"""

import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from terminal import ROOT, driftyard

from sim.batch import DatasetTask, obtain
from sim.settings import RecordSettings
from vo.contract.dataset import DatasetWriter, read_manifest
from vo.contract.errors import DatasetError

pytestmark = [pytest.mark.gl, pytest.mark.slow]

YARD = """<mujoco><asset>
<texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".6 .6 .5"
 width="64" height="64"/>
<material name="t" texture="t" texrepeat="4 4" texuniform="true"/></asset><worldbody>
<light pos="0 0 4"/><geom type="plane" size="5 5 1" material="t"/></worldbody></mujoco>"""
SMALL = [
    word
    for setting in (
        "rig.width_px=96",
        "rig.height_px=72",
        "rig.rate_hz=20",
        "drive.distance_m=0.3",
        "render.samples=0",
        "render.shadow_size_px=256",
    )
    for word in ("--set", setting)
]
MANY = ["generate", "yard.xml", "--out", "many", "--count", "2", *SMALL]
NAMES = ["yard-00000", "yard-00001"]
IN_THE_MIDDLE = 2
"""Pictures that there are when something happens."""
PATIENCE_S = 90


def content(dataset: Path) -> dict[str, bytes]:
    files = (path for path in dataset.rglob("*") if path.is_file())
    return {path.relative_to(dataset).as_posix(): path.read_bytes() for path in files}


def stamps(dataset: Path) -> dict[Path, tuple[int, int]]:
    """What a file that is written again would change, even to the same bytes."""
    about = {path: path.stat() for path in dataset.rglob("*")}
    return {path: (stat.st_ino, stat.st_mtime_ns) for path, stat in about.items()}


def start(*words: str, cwd: Path, **variables: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", *words],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def until(condition, process: subprocess.Popen[str]):
    """Wait for something to be true while a command runs, and return it."""
    end_s = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert process.poll() is None, "the command ended too early"
        assert time.monotonic() < end_s, "nothing happened"
        time.sleep(0.01)
    return found


def writer_of(partial: Path) -> int | None:
    """The process that is in the middle of a dataset, by the folder that it holds open.

    The pictures become more meanwhile: what a dead writer left, others hold open to clear it.
    """
    before, holder = pictures(partial), holder_of(partial)
    if before < IN_THE_MIDDLE or holder is None:
        return None
    end_s = time.monotonic() + 1
    while pictures(partial) == before and time.monotonic() < end_s:
        time.sleep(0.002)
    return holder if pictures(partial) > before else None


def pictures(partial: Path) -> int:
    return len(list(partial.glob("mav0/cam0/data/*.png")))


def holder_of(partial: Path) -> int | None:
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # gone meanwhile
            if any(os.readlink(link) == str(partial) for link in (process / "fd").iterdir()):
                return int(process.name)
    return None


def partial_of(folder: Path, name: str) -> Path:
    return folder / "many" / f".{name}.partial"


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> dict[str, dict[str, bytes]]:
    """Name to content of the datasets when nothing happens."""
    folder = tmp_path_factory.mktemp("calm")
    (folder / "yard.xml").write_text(YARD)
    result = driftyard(*MANY, "--workers", 0, cwd=folder)
    assert result.returncode == 0, result.stderr
    return {name: content(folder / "many" / name) for name in NAMES}


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "yard.xml").write_text(YARD)
    return tmp_path


def test_killed_worker_costs_its_dataset_one_more_try(folder, calm):
    slow = {"DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "0.1s"}  # as if a start took long
    run = start("trials.cli", *MANY, "--workers", "1", cwd=folder, **slow)
    worker = until(lambda: writer_of(partial_of(folder, NAMES[1])), run)
    before = stamps(folder / "many" / NAMES[0])
    os.kill(worker, signal.SIGKILL)
    said, complaints = run.communicate()
    assert (run.returncode, said) == (0, "2 datasets in many\n"), complaints
    assert {path.name: content(path) for path in (folder / "many").iterdir()} == calm
    assert stamps(folder / "many" / NAMES[0]) == before

    again = driftyard(*MANY, cwd=folder)
    assert again.returncode == 0, again.stderr
    assert "2 of 2 datasets are there already" in again.stdout
    assert stamps(folder / "many" / NAMES[0]) == before


def test_obtain_finished_dataset_counts(folder, monkeypatch):
    monkeypatch.chdir(folder)
    result = driftyard("generate", "yard.xml", "--out", "d", *SMALL, cwd=folder)
    assert result.returncode == 0, result.stderr
    before, manifest = stamps(folder / "d"), read_manifest(folder / "d")
    settings = RecordSettings.model_validate(manifest["settings"])
    assert (
        obtain(DatasetTask("yard.xml", settings, Path("d"))).certificate == manifest["certificate"]
    )
    assert stamps(folder / "d") == before
    other = settings.model_copy(update={"seed": 1})
    with pytest.raises(DatasetError, match="d: exists with other settings; choose another folder"):
        obtain(DatasetTask("yard.xml", other, Path("d")))


def test_folder_locked_by_another_process_is_refused(tmp_path):
    """Such as a worker that was thought lost and is alive; a dead one's folder is taken over."""
    out = tmp_path / "d"
    with DatasetWriter(out) as first:
        first.add("a", b"a")
        with pytest.raises(DatasetError, match="another process is writing this dataset"):
            DatasetWriter(out).__enter__()
        assert (first.partial / "a").read_bytes() == b"a"
    first.partial.mkdir()
    (first.partial / "left").write_text("by the dead")
    with DatasetWriter(out) as second:
        second.commit({})
    assert [path.name for path in out.iterdir()] == ["dataset.json"]


def limited(*words: str, size: int, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `driftyard` where no file has room for more than so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        return driftyard(*words, cwd=cwd)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(("size", "file"), [(2_000, "mav0/"), (100_000, "map.png")])
def test_full_disk_names_the_file_and_leaves_nothing(folder, calm, size, file):
    sizes = {name: len(data) for name, data in calm[NAMES[0]].items()}
    assert max(sizes.values()) > size
    result = limited("generate", "yard.xml", "--out", "d", *SMALL, size=size, cwd=folder)
    assert result.returncode == 2, result.stdout + result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"driftyard: error: d: {file}")
    assert line.endswith("cannot be written (File too large)")
    assert [path.name for path in folder.iterdir()] == ["yard.xml"]


def test_full_disk_keeps_the_previous_picture(folder):
    words = ("preview", "yard.xml", "--out", "p.png", *SMALL)
    assert driftyard(*words, cwd=folder).returncode == 0
    before = (folder / "p.png").read_bytes()
    result = limited(*words, size=2_000, cwd=folder)
    assert result.returncode == 2, result.stdout + result.stderr
    assert result.stderr == "driftyard: error: p.png: cannot be written (File too large)\n"
    assert {path.name for path in folder.iterdir()} == {"yard.xml", "p.png"}
    assert (folder / "p.png").read_bytes() == before


def test_full_disk_keeps_complete_datasets(folder, calm):
    """A file system with room for one dataset and a half, in a name space of its own."""
    if subprocess.run(["unshare", "-Urm", "true"], capture_output=True, check=False).returncode:
        pytest.skip("mounting is not allowed here")
    room = round(1.5 * sum(-(-len(data) // 4096) * 4096 for data in calm[NAMES[0]].values()))
    script = (
        f"mkdir disk && mount -t tmpfs -o size={room} tmpfs disk && cp yard.xml disk && cd disk || "
        'exit 99; "$@"; echo status $?; ls -A . many; cat many/yard-*/dataset.json'
    )
    command = [sys.executable, "-m", "trials.cli", *MANY, "--workers", "0"]
    result = subprocess.run(
        ["unshare", "-Urm", "sh", "-c", script, "sh", *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    said, listed = result.stdout.split("status 1\n")
    assert "1 datasets in many" in said
    (name,) = (line for line in listed.splitlines() if line in NAMES)
    assert ".partial" not in listed
    assert calm[name]["dataset.json"].decode() in listed
    complaints = [" ".join(x.split()) for x in result.stderr.split("many/yard-") if x]
    assert len(complaints) == 1
    assert all(line.endswith("cannot be written (No space left on device)") for line in complaints)
