"""The environment variables that choose an OpenGL driver: each fault is named in one line."""

import pytest

from sim.graphics import VARIABLES, GraphicsError, check_variables, explain_fault, has_library


@pytest.fixture(autouse=True)
def _unset(monkeypatch):
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("name", "value", "wanted", "fragment"),
    [
        ("MUJOCO_GL", "foo", "auto", "^MUJOCO_GL=foo: no such backend; unset it, or set egl or"),
        ("MUJOCO_GL", "egl", "osmesa", "^MUJOCO_GL=egl: rules out the backend osmesa"),
        ("PYOPENGL_PLATFORM", "glx", "auto", "^PYOPENGL_PLATFORM=glx: unset it, or set egl or"),
        ("PYOPENGL_PLATFORM", "osmesa", "egl", "^PYOPENGL_PLATFORM=osmesa: unset it, or set egl$"),
        ("MUJOCO_EGL_DEVICE_ID", "abc", "auto", "^MUJOCO_EGL_DEVICE_ID=abc: expected the number"),
        ("MUJOCO_EGL_DEVICE_ID", "", "auto", "^MUJOCO_EGL_DEVICE_ID=: expected the number"),
        ("MUJOCO_EGL_DEVICE_ID", "-1", "auto", "^MUJOCO_EGL_DEVICE_ID=-1: expected the number"),
    ],
)
def test_check_variables_unusable_value_is_named(monkeypatch, name, value, wanted, fragment):
    monkeypatch.setenv(name, value)
    with pytest.raises(GraphicsError, match=fragment):
        check_variables(wanted)
    assert str(explain_fault(RuntimeError("?"))).startswith(name) or wanted != "auto"


@pytest.mark.parametrize("value", ["", "EGL", "glfw", "disabled", "1"])
def test_check_variables_values_of_mujoco_are_accepted(monkeypatch, value):
    monkeypatch.setenv("MUJOCO_GL", value)
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "0")
    if value.lower() != "egl" or has_library("egl"):
        check_variables()


def test_check_variables_missing_library_is_named(monkeypatch):
    monkeypatch.setattr("sim.graphics.LIBRARIES", {"egl": ("libNone.so.1",), "osmesa": ()})
    monkeypatch.setenv("MUJOCO_GL", "egl")
    with pytest.raises(GraphicsError, match=r"^MUJOCO_GL=egl: libNone\.so\.1 is missing; unset it"):
        check_variables()


def test_explain_fault_names_driver_variables_that_are_set(monkeypatch):
    monkeypatch.setenv("GALLIUM_DRIVER", "none")
    said = explain_fault(AttributeError("no glGetError\nhere."))
    assert said.startswith("no glGetError here; change or unset ")
    assert "GALLIUM_DRIVER=none" in said
