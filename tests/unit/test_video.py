"""H.264 of a camera: what it leaves of moving images, by quality and by what came before."""

import sys

import cv2
import numpy as np
import pytest

from sim.imaging.video import Video
from vo.contract.arrays import Image
from vo.contract.errors import SettingsError

SIZE = 62, 95


def moving_images(count: int, channels: tuple[int, ...] = ()) -> list[Image]:
    """Smooth random texture, which moves by 2 px to the left a frame."""
    shape = SIZE[0], SIZE[1] + 2 * count, *channels
    noise = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    whole = np.clip(128 + 160 * smooth, 0, 255).astype(np.uint8)
    return [np.ascontiguousarray(whole[:, 2 * k : 2 * k + SIZE[1]]) for k in range(count)]


def errors(images: list[Image], crf: int) -> list[float]:
    video = Video(crf)
    return [float(np.abs(video.through(x).astype(float) - x).mean()) for x in images]


@pytest.mark.parametrize("channels", [(), (3,)])
def test_quality_falls_with_the_rate_factor(channels: tuple[int, ...]):
    images = moving_images(4, channels)
    fine, coarse = (np.mean(errors(images, crf)) for crf in (4, 40))
    assert (Video(30).through(images[0]).shape, fine < 10) == (images[0].shape, True)
    assert coarse > fine + 4


def test_image_depends_on_those_before_it():
    before, now = moving_images(2)
    video = Video(30)
    video.through(before)
    assert (video.through(now) != Video(30).through(now)).mean() > 0.2


def test_equal_images_give_equal_bytes():
    first, second = Video(30), Video(30)
    for image in moving_images(5, (3,)):
        np.testing.assert_array_equal(first.through(image), second.through(image))


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SettingsError, match=r"h264_crf = 30 needs .*driftyard\[video\]"):
        Video(30)
