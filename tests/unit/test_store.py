"""Results that machines share: written once, read back to the byte, damaged or unwritable ones."""

import errno
import json
from importlib.util import find_spec
from pathlib import Path

import pytest
from fsspec.implementations.memory import MemoryFileSystem
from small_tasks import Measured, measure_once

from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.store import StoreError, fetch, present, publish, sharing
from trials.execution.tasks import Task


@pytest.fixture
def result(tmp_path) -> Path:
    """A folder and a file with a companion, in a cache."""
    folder = tmp_path / "one/recordings/office-0-abc"
    (folder / "mav0").mkdir(parents=True)
    (folder / "dataset.json").write_text("{}")
    (folder / "mav0/data.bin").write_bytes(bytes(range(256)))
    run = tmp_path / "one/runs/office-0-abc.txt"
    run.parent.mkdir()
    run.write_text("1 2 3\n")
    run.with_name("office-0-abc.frames.csv").write_text("a,b\n")
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def put_both(result: Path, url: str) -> None:
    with sharing(url):
        publish(result / "one/recordings/office-0-abc")
        publish(result / "one/runs/office-0-abc.txt")


@pytest.mark.parametrize("kind", ["folder", "memory://driftyard-test"])
def test_results_of_one_machine_are_present_on_another(result, kind):
    url = str(result / "store") if kind == "folder" else kind
    put_both(result, url)
    (result / "two/recordings").mkdir(parents=True)
    (result / "two/runs").mkdir()
    with sharing(url):
        for name in ("recordings/office-0-abc", "runs/office-0-abc.txt"):
            assert present(result / "two" / name).exists()
        assert not fetch(result / "two/runs/other.txt")
    assert content(result / "two") == content(result / "one")


def test_object_without_index_is_absent_and_written_again(result):
    put_both(result, str(result / "store"))
    index = result / "store/recordings/office-0-abc.index.json"
    about = json.loads(index.read_text())
    assert {"sha256", "code", "host", "time"} <= {*about}
    for half in (None, "{"):
        index.unlink() if half is None else index.write_text(half)
        with sharing(str(result / "store")):
            assert not fetch(result / "two/recordings/office-0-abc")
        put_both(result, str(result / "store"))
        assert json.loads(index.read_text())["sha256"] == about["sha256"]


def test_damaged_object_is_named_and_leaves_nothing(result):
    put_both(result, str(result / "store"))
    (result / "store/recordings/office-0-abc/mav0/data.bin").write_bytes(b"half")
    with sharing(str(result / "store")), pytest.raises(StoreError, match=r"data\.bin is damaged"):
        fetch(result / "two/recordings/office-0-abc")
    assert content(result / "two") == {}


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("nowhere://bucket", "store nowhere://bucket: cannot be used"),
        ("s3://bucket/name", "s3fs"),
        ("/proc/nowhere", "store /proc/nowhere: cannot be written"),
    ],
)
def test_unusable_store_is_one_line_before_any_task(url, said, tmp_path):
    if url.startswith("s3") and find_spec("s3fs"):
        pytest.skip("s3fs is installed")
    with pytest.raises(StoreError, match=said) as caught, using(Workers(0, store=url)):
        compute([Task("nothing", "x", (tmp_path / "done").write_text, ("x",))])
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "done").exists()


def test_store_that_fills_up_ends_the_command(tmp_path, monkeypatch):
    """What was not written to the end is not there, and is written with the space for it."""
    monkeypatch.chdir(tmp_path)
    write, url = MemoryFileSystem.pipe_file, "memory://full"

    def pipe_file(self, path, value, **words):
        if "trial-" in path:
            write(self, path, value[:10], **words)
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, path, value, **words)

    log = str(tmp_path / "log")
    tasks = [Task("trial", "one", measure_once, (log, 1), list[Measured])]
    with monkeypatch.context() as full:
        full.setattr(MemoryFileSystem, "pipe_file", pipe_file)
        with pytest.raises(StoreError) as caught, using(Workers(0, store=url)):
            compute(tasks)
    assert str(caught.value).endswith("cannot be written (No space left on device)")
    result = tasks[0].file
    with sharing(url):
        result.unlink()
        assert not fetch(result)
    with using(Workers(0, store=url)):
        compute(tasks)
    result.unlink()
    with sharing(url):
        assert fetch(result)
