"""Data sets of PyTorch: loaders in other processes, and the documented examples."""

import os
import pickle
import re
import subprocess
import sys

import pytest
from terminal import ROOT
from test_samples import FRAMES, write_folder

import driftyard as dy

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # of Python 3.12


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("torch")
    for name in ("a", "b"):
        write_folder(place / name)
    return place


def dimmed(sample):
    """A transform that workers can import."""
    return sample | {"left": 0.5 * sample["left"]}


def test_samples_are_tensors(folder):
    data = dy.torch.StereoDataset(folder / "a", ("left", "flow", "T_world_cam", "timestamp_ns"))
    assert isinstance(data, torch.utils.data.Dataset)
    assert len(data) == FRAMES - 1
    sample = data[1]
    assert sample["left"].dtype == sample["flow"].dtype == torch.float32
    assert sample["flow_valid"].dtype == torch.bool
    assert sample["timestamp_ns"].item() == 100_000_000
    assert sample["T_world_cam"].shape == (4, 4)
    assert len(data + data) == 2 * len(data)
    assert len(list(iter(data))) == len(data)


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_workers_load_the_same_batches(folder, start):
    data = dy.torch.StereoDataset([folder / "a", folder / "b"], transform=dimmed)
    here = list(torch.utils.data.DataLoader(data, batch_size=3))
    loader = torch.utils.data.DataLoader(
        data, batch_size=3, num_workers=2, multiprocessing_context=start
    )
    there = list(loader)
    assert [x.shape[0] for x in (y["left"] for y in there)] == [3, 3, 2]
    for a, b in zip(here, there, strict=True):
        assert set(a) == set(b)
        assert all(torch.equal(a[x], b[x]) for x in a)


def test_bags_are_read_by_forked_workers(tmp_path):
    from test_bags import PAIRS, simple_bag

    ds = dy.open(simple_bag(tmp_path / "run.bag"))
    assert ds[0].left.any()  # the file is open here
    data = ds.to_torch(("left", "right"), as_float=False)
    loader = torch.utils.data.DataLoader(
        data, batch_size=None, num_workers=2, multiprocessing_context="fork", shuffle=True
    )
    for _ in range(3):
        found = sorted(int(x["left"].sum()) for x in loader)
        assert found == sorted(int(left.sum()) for left, _ in PAIRS)


def test_pickles_hold_paths_alone(folder):
    data = dy.open(folder / "a").to_torch()
    _ = data[0]
    pickled = pickle.dumps(data)
    assert len(pickled) < 2000
    assert torch.equal(pickle.loads(pickled)[3]["left"], data[3]["left"])


def test_error_of_a_worker_is_one_of_the_family(folder, tmp_path):
    broken = write_folder(tmp_path / "broken")
    next((broken / "image_lcam_front").glob("000002*")).write_bytes(b"")
    data = dy.torch.StereoDataset(broken)
    loader = torch.utils.data.DataLoader(data, num_workers=1, multiprocessing_context="fork")
    with pytest.raises(dy.ImageError, match="the file is empty"):
        list(loader)


def test_documented_code_runs(folder, monkeypatch):
    page = (ROOT / "docs/api.md").read_text()
    (block,) = re.findall(r"```python\n(import torch\n.*?)```", page, re.DOTALL)
    monkeypatch.chdir(folder)
    names = {"dy": dy}
    exec(compile(block, "docs/api.md", "exec"), names)
    assert names["batch"]["left"].shape == (4, 3, 48, 64)


def test_torch_is_not_imported_unless_used():
    code = "import sys, driftyard as dy; dy.open; print('torch' in sys.modules)"
    here = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], env=here, capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr
