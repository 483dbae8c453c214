"""Devices of EGL, and the numbers by which MuJoCo chooses them."""

import mujoco
import pytest
from terminal import driftyard

from sim.egl_devices import EglDevice, list_devices, mujoco_numbers


def devices(*cuda):
    return [EglDevice(k, f"/dev/dri/{k}", x, x is None) for k, x in enumerate(cuda)]


@pytest.mark.parametrize(
    ("cuda", "visible", "expected"),
    [
        ((None,), "", [0]),
        ((1, 0, None), "", [1, 0, 2]),
        ((2, 3, 0), "3,2", [1, 0, None]),
        ((0, 1), "6,7", [0, 1]),
        ((0, 1), "6", [0, None]),
        ((0, 1), "GPU-1234", [0, 1]),
    ],
)
def test_mujoco_numbers_choose_the_devices(cuda, visible, expected, monkeypatch):
    """MuJoCo's own selection, of the drivers' numbers, agrees."""
    assert mujoco_numbers(devices(*cuda), visible) == expected
    egl = pytest.importorskip("mujoco.egl", reason="needs EGL")
    if not hasattr(egl, "_select_egl_device"):
        pytest.skip(f"MuJoCo {mujoco.__version__} selects by the place in the list")
    known = {x: k for k, x in enumerate(cuda) if x is not None} or None
    order = egl._parse_cuda_device_ids(visible)
    everything = egl._ordered_egl_devices([*range(len(cuda))], known, order)
    for device, number in enumerate(expected):
        if number is not None:
            assert egl._select_egl_device(everything, known, order, number) == device


@pytest.mark.gl
def test_doctor_lists_the_devices_that_render(tmp_path):
    done = driftyard("doctor", "--devices", cwd=tmp_path)
    assert done.returncode == (0 if "renders" in done.stdout else 1)
    assert ("no device" in done.stdout) == (not list_devices())
