"""Machine code on the disk: kept while nothing that it was made from changes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from folders import BASELINE_M, F_PX, HEIGHT, WIDTH, wall
from terminal import ROOT

from vo.contract.compilation import compiled, fingerprint
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.censure import _pass_rows
from vo.odometry import StereoOdometry
from vo.precompile import compile_ahead

OFFSET = object()

CALLEE = '''"""Callee."""
from vo.contract.compilation import compiled

FACTOR = 2.0

@compiled()
def scale(x):
    return FACTOR * x
'''
CALLER = '''"""Caller in another file."""
from callee import scale
from vo.contract.compilation import compiled

@compiled()
def scale_twice(x):
    return scale(scale(x))
'''
UNRELATED = '''"""Neither calls nor is called."""
from vo.contract.compilation import compiled

@compiled()
def negate(x):
    return -x
'''
MAIN = """
from numba.core import event
from callee import scale
from caller import scale_twice
from unrelated import negate

class Recorder(event.Listener):
    names = set()
    def on_start(self, event):
        self.names.add(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

event.register("numba:compile", Recorder())
print(scale_twice(1.0), negate(1.0), *sorted(Recorder.names & {"scale", "scale_twice", "negate"}))
"""


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Three modules with a compiled function each, whose machine code is kept."""
    folder = tmp_path_factory.mktemp("original")
    for name, text in (("callee", CALLEE), ("caller", CALLER), ("unrelated", UNRELATED)):
        (folder / f"{name}.py").write_text(text)
    assert run_package(folder) == "4.0 -1.0 negate scale scale_twice"
    return folder


@pytest.fixture
def package(original, tmp_path):
    """A copy to edit; machine code holds at any place."""
    return shutil.copytree(original, tmp_path / "package")


def test_unchanged_copy_recompiles_nothing(package):
    assert run_package(package) == "4.0 -1.0"


def run_package(folder: Path, **environment: str) -> str:
    path = os.pathsep.join([str(folder), str(ROOT)])
    kept = {x: y for x, y in os.environ.items() if x != "NUMBA_CACHE_DIR"}
    result = subprocess.run(
        [sys.executable, "-c", MAIN],
        env={**kept, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    compiled_now = len(result.stdout.split()) > 2
    assert ("compiling machine code (once" in result.stderr) == compiled_now
    return result.stdout.strip()


def edit(file: Path, before: str, after: str) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))


def test_edited_callee_recompiles_its_caller_only(package):
    edit(package / "callee.py", "FACTOR * x", "FACTOR * x + 1")
    assert run_package(package) == "7.0 -1.0 scale scale_twice"


def test_edited_constant_recompiles_its_users(package):
    edit(package / "callee.py", "FACTOR = 2.0", "FACTOR = 3.0")
    assert run_package(package) == "9.0 -1.0 scale scale_twice"


def test_edited_caller_recompiles_itself_only(package):
    edit(package / "caller.py", "scale(scale(x))", "scale(scale(scale(x)))")
    assert run_package(package) == "8.0 -1.0 scale_twice"


def test_edited_comment_recompiles_nothing(package):
    edit(package / "callee.py", "    return", '    """Scale."""\n    # by two\n    return')
    edit(package / "callee.py", '"""Callee."""', '"""Callee.\n\nOf another function.\n"""')
    assert run_package(package) == "4.0 -1.0"


def test_read_only_sources_use_the_user_folder(package):
    """A file in the place of `__pycache__` stands for a folder that cannot be written."""
    for file in (package / "__pycache__").iterdir():
        file.unlink()
    (package / "__pycache__").rmdir()
    (package / "__pycache__").touch()
    user = {"XDG_CACHE_HOME": str(package / "user")}
    assert run_package(package, **user) == "4.0 -1.0 negate scale scale_twice"
    assert run_package(package, **user) == "4.0 -1.0"
    assert len(list((package / "user" / "driftyard").rglob("*.nbi"))) == 3


def test_unwritable_folders_compile_in_memory(package):
    for file in (package / "__pycache__").iterdir():
        file.unlink()
    (package / "__pycache__").rmdir()
    (package / "__pycache__").touch()
    nowhere = {"XDG_CACHE_HOME": str(package / "caller.py")}
    assert run_package(package, **nowhere) == "4.0 -1.0 negate scale scale_twice"


def test_fingerprint_is_the_same_in_every_process():
    """Sets and dictionaries of names have no order of their own."""
    code = (
        "from vo.contract.compilation import fingerprint\n"
        "from vo.patches.sampling import correlate\n"
        "print(fingerprint(correlate))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(found) == 1
    assert len(found.pop().strip()) == 64


def test_fingerprint_of_a_value_that_may_change_raises():
    @compiled()
    def shifted(x: float) -> float:
        return x + OFFSET

    with pytest.raises(TypeError, match="import constants and functions by name"):
        fingerprint(shifted)


def test_compile_ahead_keeps_code_once(capsys):
    """With kept machine code nothing happens; without it, this compiles."""
    compile_ahead()
    capsys.readouterr()
    compile_ahead()
    assert capsys.readouterr().err == ""


def test_what_compile_ahead_looks_for_is_compiled_by_it():
    """Else every run would compile ahead again."""
    code = (
        "from vo import precompile\n"
        "precompile._refine(), precompile._estimate()\n"
        "print(*(bool(x.signatures) for x in precompile.LAST))"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert done.stdout.split() == [b"True", b"True"]


def test_images_of_any_layout_share_machine_code():
    """Views into larger images, as of pairs side by side, and read-only ones, as of messages."""
    rig = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)

    def track(change):
        odometry = StereoOdometry(rig)
        for i, pair in enumerate(wall(2, 4)):
            assert odometry.track(StereoFrame(i, *map(change, pair))).T_odom_cam is not None

    def frozen(image):
        image = image.copy()
        image.flags.writeable = False
        return image

    track(np.copy)
    before = [*_pass_rows.signatures]
    track(frozen)
    track(lambda image: np.hstack([image, image])[:, : image.shape[1]])
    assert _pass_rows.signatures == before


def test_run_imports_neither_simulator_nor_studies():
    """What `driftyard run` needs for its first frame; each of these takes a quarter of a second."""
    code = (
        "import sys, trials.cli.main, trials.cli.run, vo.precompile, trials.estimators.choice\n"
        "print(*sorted({'mujoco', 'OpenGL', 'gymnasium', 'matplotlib', 'pandas', 'rerun', 'torch',"
        " 'scipy.stats', 'scipy.optimize', 'PIL', 'numba.cuda', 'gtsam'} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.split() == []
