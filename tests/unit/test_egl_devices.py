"""Devices of EGL, and the numbers by which MuJoCo chooses them."""

import os

import mujoco
import pytest
from terminal import driftyard

from sim.egl_devices import EglDevice, list_devices, mujoco_numbers, vulkan_variables
from trials.execution import devices as claims


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


def test_worker_chooses_one_gpu_for_opengl_and_vulkan(tmp_path, monkeypatch):
    """Vulkan lists the GPU at the same address alone; what a user has set stays."""
    for number, address in ((128, "0000:02:00.0"), (129, "10de:81:00.1"), (130, "soc")):
        (tmp_path / f"devices/{address}").mkdir(parents=True)
        (tmp_path / f"class/drm/renderD{number}").mkdir(parents=True)
        link = tmp_path / f"class/drm/renderD{number}/device"
        link.symlink_to(tmp_path / f"devices/{address}")
    given = {x: vulkan_variables(f"/dev/dri/renderD{x}", tmp_path) for x in (128, 129, 130, 131)}
    assert given[128]["DRI_PRIME"] == "pci-0000_02_00_0"
    assert given[129]["DRI_PRIME"] == "pci-10de_81_00_1"
    assert (given[130], given[131], vulkan_variables("", tmp_path)) == ({}, {}, {})

    monkeypatch.setattr(claims, "gpus", lambda: {0: "/dev/dri/renderD128", 3: "renderD129"})
    monkeypatch.setattr(claims, "vulkan_variables", lambda x: vulkan_variables(x, tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    chosen: list[tuple[str | None, ...]] = []
    with monkeypatch.context() as environment:
        for x in (claims.VARIABLE, *claims.OF_VULKAN):
            environment.delenv(x, raising=False)
        environment.setattr(os, "environ", {**os.environ})
        held = [claims.choose_gpu.__wrapped__()]
        chosen.append((os.environ[claims.VARIABLE], os.environ["DRI_PRIME"]))
        os.environ["DRI_PRIME"] = "1"
        held.append(claims.choose_gpu.__wrapped__())
        chosen.append((os.environ[claims.VARIABLE], os.environ["DRI_PRIME"]))
    assert chosen == [("0", "pci-0000_02_00_0"), ("3", "1")]
    for claim in held:
        claim.close()


@pytest.mark.gl
def test_doctor_lists_the_devices_that_render(tmp_path):
    done = driftyard("doctor", "--devices", cwd=tmp_path)
    assert done.returncode == (0 if "renders" in done.stdout else 1)
    assert ("no device" in done.stdout) == (not list_devices())
