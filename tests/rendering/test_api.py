"""The public API: every documented example runs, and errors are one family."""

import ast
import doctest
import gc
import json
import os
import pickle
import subprocess
import sys
import warnings
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from folders import wall, write_euroc
from gym_worlds import write_yard
from terminal import ROOT

import driftyard as dy
from driftyard.dataset import Dataset
from trials.estimators.choice import Named
from trials.execution.progress import counted, no_progress
from trials.gate.baseline import Design, Rules, write_baseline
from trials.gate.comparison import make_baseline
from vo.contract.remarks import Remark

pytestmark = pytest.mark.gl

SMALL = {
    "rig": {"width_px": 160, "height_px": 120, "rate_hz": 5},
    "drive": {"distance_m": 1.2, "speed_mps": 0.36},
    "render": {"samples": 0, "shadow_size_px": 512},
}
PUBLIC = {name for name in dy.__all__ if name != "__version__"}
ERRORS = {name for name in PUBLIC if name.endswith("Error")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a yard, a recording of it in `ds`, and a baseline of the gate."""
    place = tmp_path_factory.mktemp("api")
    write_yard(place)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        labels = {"flow": True, "segmentation": True}
        dy.record("yard.xml", "ds", settings=SMALL | {"labels": labels})
        overrides = ("drive.distance_m=1.2", "rig.width_px=64", "rig.height_px=48", "rig.rate_hz=5")
        overrides = (*overrides, "render.samples=0")
        design = Design(scenes=("yard.xml",), overrides=overrides)
        bar = partial(counted, no_progress)
        found = make_baseline(Named("corner_flow"), "corner_flow", Rules(), design, Path("c"), bar)
        write_baseline(Path("gate.json"), found)
    return place


@pytest.fixture
def ds(folder, monkeypatch) -> Dataset:
    monkeypatch.chdir(folder)
    return dy.open("ds")


def test_documented_examples_run(ds, in_this_process):
    run = dy.run(ds, "corner_flow", "corner_flow.txt")
    names = {"dy": dy, "np": np, "ds": ds, "run": run}
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    tests = {"driftyard": [doctest.DocTestParser().get_doctest(dy.__doc__, names, "dy", None, 0)]}
    for name in sorted(PUBLIC):
        place = getattr(dy, name)
        tests[name] = finder.find(place, name, sys.modules[place.__module__], globs=names)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Remark)  # readers see them beside the examples
        for test in chain.from_iterable(tests.values()):
            runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
    without = {name for name, found in tests.items() if not any(x.examples for x in found)}
    assert without <= ERRORS - {"DriftyardError"}


def test_import_is_light_and_registers_environments():
    code = (
        "import sys, driftyard; print(driftyard.__version__, "
        "sorted({'numpy', 'cv2', 'mujoco', 'gtsam', 'gymnasium'} & set(sys.modules)));"
        "import gymnasium; print(gymnasium.spec('driftyard/RoverNav-v0').id);"
        "print(driftyard.open.__module__, 'open' in dir(driftyard))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    version, spec, place = result.stdout.splitlines()
    assert version == f"{dy.__version__} []", result.stderr
    assert spec == "driftyard/RoverNav-v0"
    assert place == "driftyard.dataset True"


def test_unusable_driver_is_one_of_the_family():
    code = "import driftyard as dy\ntry: dy.record\nexcept dy.DriftyardError as error: print(error)"
    variables = {**os.environ, "MUJOCO_GL": "foo"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=variables, capture_output=True, text=True
    )
    assert done.stdout.startswith("no OpenGL: MUJOCO_GL=foo: no such backend"), done.stderr


def test_every_public_name_is_defined_where_it_is_said():
    for name in dy.__all__:
        assert getattr(dy, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'opne'"):
        dy.opne  # noqa: B018


def test_names_for_type_checkers_are_the_public_ones():
    tree = ast.parse(Path(dy.__file__).read_text())
    (block,) = (
        x
        for x in tree.body
        if isinstance(x, ast.If)
        and "TYPE" in ast.unparse(x.test)
        and isinstance(x.body[0], ast.ImportFrom)
    )
    imported = {(x.module, name.name) for x in block.body for name in x.names}
    modules = {("driftyard", name) for name in dy._MODULES}
    assert imported - modules == {(module, name) for name, module in dy._MODULE_OF.items()}
    assert {name for _, name in imported - modules} == PUBLIC
    assert modules <= imported
    # A module that is imported would take the place of a function of its name.
    assert {x.stem for x in Path(dy.__file__).parent.glob("*.py")} & PUBLIC == set()


def test_labels_agree_with_the_true_rig(ds):
    T = ds.T_world_cam
    step = np.linalg.inv(T[0]) @ T[1]
    v, u = np.mgrid[: ds.rig.height_px, : ds.rig.width_px]
    points = ds.rig.triangulate(np.stack([u, v], -1).astype(float), ds.disparity(0))
    assert np.nanmax(abs(points[..., 2] - ds.depth(0))) < 1e-3
    moved = (points - step[:3, 3]) @ step[:3, :3]  # p_next = T_next_now p_now, all is static
    flow = ds.rig.project(moved)[..., :2] - np.stack([u, v], -1)
    assert np.nanmedian(np.abs(flow - ds.flow(0)[..., :2])) < 1e-3
    assert set(np.unique(ds.segmentation(0))) - {0} <= set(ds.things)


def test_scores_are_those_of_the_command_line(ds):
    run = dy.run(ds, "corner_flow", "again.txt")
    command = [sys.executable, "-m", "trials.cli", "score", "ds", "again.txt", "--json"]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True)
    (figures,) = json.loads(done.stdout)
    assert figures.pop("file") == "again.txt"
    assert figures == json.loads(json.dumps(dy.score(ds, run).to_dict()))


def test_dataset_survives_pickling(ds):
    again = pickle.loads(pickle.dumps(dy.open("ds", first=2, every=3)))
    assert np.array_equal(again[0].left, ds[2].left)
    assert again.path.is_absolute()


def test_remark_is_placed_at_the_line_of_the_user(tmp_path):
    folder = write_euroc(tmp_path, wall(3))
    (folder / "mav0/cam1/data.csv").write_text("#timestamp\n100000000,100000000.png\n")
    with pytest.warns(Remark) as found:
        dy.open(folder)
    assert {x.filename for x in found} == {__file__}


def test_selected_frames_are_run_and_counted(ds):
    half = dy.open("ds", every=2)
    run = dy.run(half, "corner_flow")
    assert dy.score(half, run).frames == len(half) == len(run.frames) == (len(ds) + 1) // 2
    np.testing.assert_array_equal(half.depth(1), ds.depth(2))
    with pytest.raises(dy.SettingsError, match="a program reads all frames"):
        dy.run(half, dy.Command("true {dataset} {out}"))


class AtRest:
    """An estimator that a notebook defines."""

    def __init__(self, rig):
        self.rig = rig

    def track(self, frame):
        return dy.Estimate(frame.timestamp_ns, dy.Status.TRACKED, np.eye(4))


def test_class_of_a_notebook_is_run(ds):
    run = dy.run(ds, AtRest)
    assert run.estimator.endswith("AtRest")
    assert 80 < dy.score(ds, run).drift_pct <= 100
    folder = run.path.parent
    assert folder.is_dir()
    del run
    gc.collect()
    assert not folder.exists()


def test_objects_show_themselves(ds):
    run = dy.run(ds, AtRest)
    for shown in (ds, run, dy.score(ds, run)):
        assert shown._repr_html_().count("<tr>") > 2
        assert len(repr(shown)) < 800
    assert "data:image/png" in ds._repr_html_()
    assert dy.plot(ds, run)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda ds: ds.normals(0), "ds: has no normals labels, only depth, disparity, flow, segm"),
        (lambda ds: ds.flow(-1), "ds: the last frame, [0-9]+, has no flow"),
        (lambda ds: ds[999], "ds: frame 999: the frames are 0 to"),
        (lambda ds: dy.open("yard.xml"), "yard.xml: not a recording; expected a driftyard"),
        (lambda ds: dy.record("yard.xml", "ds"), "ds: already exists"),
        (lambda ds: dy.record("yard.xml", "yard.xml/new"), "yard.xml.*: Not a directory"),
        (lambda ds: dy.run(ds, AtRest, "yard.xml/run.txt"), "yard.xml/run.* cannot be written"),
        (lambda ds: dy.record("yrad", "new"), "unknown scene yrad; valid: asphalt"),
        (lambda ds: dy.record("yard.xml", "new", settings={"seed": None}), "seed is None"),
        (lambda ds: dy.record("yard.xml", "new", settings={"rig.width": 9}), "rig.width"),
        (lambda ds: dy.run(ds, "orb"), "unknown estimator orb; valid: corner_flow, driftyard"),
        (lambda ds: dy.run(ds, AtRest(ds.rig)), "AtRest: pass the class, not an instance"),
        (lambda ds: dy.run(ds, 5), "estimator 5: expected a name, a class or a Command"),
        (lambda ds: dy.make_estimator(ds.rig, dy.Command("a {dataset} {out}")), "a: a program re"),
        (lambda ds: dy.run(ds, AtRest, settings={"a": 1}), "has no Settings"),
        (lambda ds: dy.run(ds, out="."), "is a folder; expected the name of a trajectory file"),
        (lambda ds: dy.score(ds, "nowhere.txt"), "nowhere.txt: cannot be read"),
        (lambda ds: dy.score(ds, "ds/dataset.json", frame="imu"), "frame imu: expected cam or bo"),
        (lambda ds: dy.gate("gate.json", accept=["all"]), "unknown all; valid: datasets, platform"),
        (lambda ds: dy.plot(ds).save("path.gif"), "path.gif: the name must end in .png or .svg"),
    ],
)
def test_bad_input_is_one_family_of_errors(ds, call, message):
    with pytest.raises(dy.DriftyardError, match=message) as raised:
        call(ds)
    assert "\n" not in str(raised.value)
    assert not Path("new").exists()


def test_recordings_without_labels_say_so(tmp_path):
    ds = dy.open(write_euroc(tmp_path, wall(3)))
    for read in (lambda: ds.depth(0), lambda: ds.imu, lambda: ds.wheels, lambda: ds.T_world_cam):
        with pytest.raises(dy.DatasetError, match="has no"):
            read()
    assert ds.labels == ()
    assert "no poses" in repr(ds)
    assert list(ds.table()) == ["timestamp_ns"]
