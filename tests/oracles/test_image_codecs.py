"""Our encoders: what OpenCV reads is what went in, to the bit, and smaller than its own."""

import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.dataset.image_codecs import encode_float, encode_png
from vo.recordings.images import read_codes, read_float, read_grey

SLOPE = np.add.outer(np.arange(61), 0.37 * np.arange(91)).astype(np.float32)
"""Smooth, as a depth is."""
RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    "label",
    [
        SLOPE,
        1 / (1 + SLOPE),
        np.where(SLOPE > 40, np.float32(np.nan), SLOPE),
        np.where(SLOPE > 40, -np.float32(np.inf), -SLOPE),
        np.zeros((480, 640), np.float32),
        RNG.random((61, 641), np.float32),
        np.full((1, 1), np.float32(np.nan)),
        SLOPE[::-1, ::2],
        np.stack([SLOPE, 1 / (1 + SLOPE), np.full_like(SLOPE, np.nan)], axis=-1),
    ],
)
def test_encode_float_round_trips(label, tmp_path):
    path = tmp_path / "label.tiff"
    path.write_bytes(encode_float(label))
    back = read_float(path, channels=3 if label.ndim == 3 else 1)
    assert back.tobytes() == np.ascontiguousarray(label).tobytes()


def test_encode_float_is_smaller_than_opencv():
    options = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_LZW]
    options += [cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_FLOATINGPOINT]
    label = 40 / (1 + np.add.outer(np.arange(480), np.arange(640))).astype(np.float32)
    assert len(encode_float(label)) < len(cv2.imencode(".tiff", label, options)[1])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_encode_png_round_trips(dtype, tmp_path):
    image = RNG.integers(0, np.iinfo(dtype).max, (33, 47), dtype, endpoint=True)
    path = tmp_path / "image.png"
    path.write_bytes(encode_png(image))
    np.testing.assert_array_equal(read_codes(path), image)
    if dtype == np.uint8:
        np.testing.assert_array_equal(read_grey(path), image)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_encode_png_follows_the_standard(height, width, seed):
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    data = encode_png(image)
    back = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(back[..., ::-1], image)
    at = 8
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        end = at + 8 + length
        assert zlib.crc32(data[at + 4 : end]) == int.from_bytes(data[end : end + 4], "big")
        at = end + 4
    assert data[-8:-4] == b"IEND"
