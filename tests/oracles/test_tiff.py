"""Our TIFF encoder against OpenCV's: the same file, byte for byte."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.tiff import encode_label
from vo.contract.files import encode_float

SLOPE = np.add.outer(np.arange(61), 0.37 * np.arange(90)).astype(np.float32)
"""Smooth, as a depth is; more than one strip, the last one shorter."""


@pytest.mark.parametrize(
    "label",
    [
        SLOPE,
        1 / (1 + SLOPE),
        np.where(SLOPE > 40, np.float32(np.nan), SLOPE),
        np.zeros((480, 640), np.float32),
        np.random.default_rng(0).random((61, 641), np.float32),  # fills the table
        np.full((1, 1), np.float32(np.nan)),
        np.random.default_rng(1).random((3, 2048), np.float32),
        np.random.default_rng(2).random((3, 2049), np.float32),  # a row is more than a strip
        np.stack([SLOPE] * 3, axis=-1),
    ],
)
def test_bytes_are_opencvs(label):
    data = encode_label(label)
    assert data == encode_float(label)
    back = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(back, label[..., ::-1] if label.ndim == 3 else label)


@given(st.integers(1, 2048), st.integers(0, 2048), st.integers(0, 2**32 - 1))
def test_any_length_of_codes_ends_as_opencvs(width, smooth, seed):
    row = np.random.default_rng(seed).random((1, width), np.float32)
    row[:, :smooth] = 1.0
    assert encode_label(row) == encode_float(row)
