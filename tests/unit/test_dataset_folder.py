"""Dataset folders are exchanged whole, and what killed writers left is found."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from folders import wall, write_euroc

from vo.contract import partial
from vo.contract.dataset import MANIFEST, OWN_TABLES, RECTIFIED_EYE, DatasetWriter
from vo.contract.errors import DatasetError
from vo.contract.files import write_text
from vo.recordings.readers import open_sequence

KILLED = 9


def write(out: Path, text: str, overwrite: bool = True) -> None:
    with DatasetWriter(out, overwrite) as writer:
        for k in range(3):
            writer.add(f"mav0/cam0/{k}", text.encode())
        writer.commit({"seed": text})


def text_of(folder: Path) -> str:
    """The text of a dataset, all files of which must be there and agree."""
    texts = {(folder / f"mav0/cam0/{k}").read_text() for k in range(3)}
    assert (folder / MANIFEST).is_file()
    assert len(texts) == 1
    return texts.pop()


def kill_within(function: Callable[[], None], owner: object, name: str, call: int = 1) -> None:
    """Run in a process that dies, as by SIGKILL, where it makes a call of the standard library."""
    child = os.fork()
    if child == 0:
        left = call

        def die(*_: object, **__: object) -> object:
            nonlocal left
            left -= 1
            return original(*_, **__) if left else os._exit(KILLED)

        original = getattr(owner, name)
        setattr(owner, name, die)
        try:
            function()
        finally:
            os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == KILLED


def hidden(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


@pytest.fixture
def no_exchange(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flag that the kernel refuses, as file systems without an exchange do."""
    monkeypatch.setattr(partial, "RENAME_EXCHANGE", 1 << 20)


def test_overwrite_killed_at_removal_leaves_the_new_dataset(tmp_path):
    out = tmp_path / "x"
    write(out, "old")
    kill_within(lambda: write(out, "new"), shutil, "rmtree")
    assert text_of(out) == "new"
    assert hidden(tmp_path) == [".x.partial"]
    write(tmp_path / "y", "other")
    assert hidden(tmp_path) == []
    assert text_of(out) == "new"


def test_overwrite_killed_before_exchange_leaves_the_old_dataset(tmp_path):
    out = tmp_path / "x"
    write(out, "old")
    kill_within(lambda: write(out, "new"), os, "fsencode")
    assert text_of(out) == "old"
    write(out, "newer")
    assert (text_of(out), hidden(tmp_path)) == ("newer", [])


@pytest.mark.usefixtures("no_exchange")
def test_overwrite_without_exchange_is_by_renames(tmp_path):
    write(tmp_path / "x", "old")
    write(tmp_path / "x", "new")
    assert (text_of(tmp_path / "x"), hidden(tmp_path)) == ("new", [])


@pytest.mark.usefixtures("no_exchange")
def test_kill_between_renames_loses_no_dataset(tmp_path):
    out = tmp_path / "x"
    write(out, "old")
    kill_within(lambda: write(out, "new"), Path, "rename", call=2)
    assert not out.exists()
    write(tmp_path / "y", "other")  # it clears what is of no use
    assert text_of(tmp_path / ".x.partial") == "new"
    with pytest.raises(DatasetError, match="already exists"):
        write(out, "newer", overwrite=False)
    assert text_of(out) == "old"


def test_dataset_that_appears_meanwhile_is_not_replaced(tmp_path):
    out = tmp_path / "x"
    with DatasetWriter(out) as writer:
        (out / "mine").mkdir(parents=True)
        with pytest.raises(DatasetError, match="already exists"):
            writer.commit({})
    assert (out / "mine").is_dir()


def test_folders_of_living_writers_are_not_cleared(tmp_path):
    with DatasetWriter(tmp_path / "x") as slow:
        slow.add("mav0/a", b"a")
        (tmp_path / ".y.partial").mkdir()  # of a writer that is just starting
        (tmp_path / ".notes.partial").mkdir()
        (tmp_path / ".notes.partial/mine.txt").write_text("of the user")
        write(tmp_path / "z", "z")
        assert hidden(tmp_path) == [".notes.partial", ".x.partial", ".y.partial"]
        slow.commit({})
    assert (tmp_path / "x/mav0/a").read_bytes() == b"a"


@pytest.mark.parametrize("overwrite", [False, True])
def test_file_in_place_of_a_dataset_is_refused(tmp_path, overwrite):
    (tmp_path / "x").write_text("mine")
    with pytest.raises(DatasetError, match=r"exists|is not overwritten"):
        DatasetWriter(tmp_path / "x", overwrite)


def test_partial_file_of_a_killed_process_is_cleared(tmp_path):
    out = tmp_path / "t[1].txt"
    kill_within(lambda: write_text(out, "old"), Path, "replace")
    (tmp_path / f".t[1].{os.getppid()}.partial.txt").write_text("of a running process")
    assert len(hidden(tmp_path)) == 2
    write_text(out, "new")
    assert hidden(tmp_path) == [f".t[1].{os.getppid()}.partial.txt"]
    assert out.read_text() == "new"


def torn(folder: Path, own: str, comment: str = f"left {RECTIFIED_EYE}") -> Path:
    """A recording that names itself ours by a table and the comment of a camera."""
    write_euroc(folder, wall(2))
    sheet = folder / "mav0/cam0/sensor.yaml"
    sheet.write_text(f"{sheet.read_text()}comment: {comment}\n")
    table = folder / "mav0" / own
    table.parent.mkdir(parents=True, exist_ok=True)
    table.write_text("#timestamp [ns]\n")
    return folder


@pytest.mark.parametrize("own", OWN_TABLES)
def test_dataset_without_manifest_is_not_opened(tmp_path, own):
    folder = torn(tmp_path / "d", own)
    for place in (folder, folder / "mav0"):
        with pytest.raises(DatasetError, match=rf"{MANIFEST}: is missing, though mav0/{own}"):
            open_sequence(place)


def test_dataset_without_its_wheels_is_not_opened(tmp_path):
    folder = torn(tmp_path / "d", OWN_TABLES[0])
    listed = '{"schema_version": 1, "sha256": {"mav0/wheels0/data.csv": ""}}'
    (folder / MANIFEST).write_text(listed)
    with pytest.raises(DatasetError, match=r"wheels0/data\.csv: is missing"):
        open_sequence(folder)


def test_recordings_of_other_origin_open_without_manifest(tmp_path):
    assert len(open_sequence(torn(tmp_path / "d", OWN_TABLES[0], comment="of a robot"))) == 2
    assert len(open_sequence(torn(tmp_path / "e", "wheels0/sensor.yaml"))) == 2
