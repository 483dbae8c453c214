"""Float labels as TIFF: the bytes that `encode_float` gives, in two thirds of its time.

The coder's time is that of finding its way through a table of strings, one byte after the other.
Here an entry has 4 bytes, where OpenCV's library has 16, and nearly each is found at first sight.

Source:
    TIFF 6.0, section 13 (LZW); Adobe Photoshop TIFF Technical Note 3 (floating-point predictor).
"""

import struct

import numba
import numpy as np

from vo.contract.arrays import Array
from vo.contract.files import encode_float

STRIP_BYTES = 8192
"""Rows are gathered into strips of at most that."""
CLEAR, END, FIRST, FULL = 256, 257, 258, 4094
"""The code that empties the table, the one that ends a strip, and those of the table's entries."""
WIDTH_MIN = 9
SLOT_BITS = 15
SLOTS = 1 << SLOT_BITS
SHORT, LONG = 3, 4
"""TIFF's types of 16 and 32 bits."""


def encode_label(label: Array) -> bytes:
    """Encode (H, W) or (H, W, 3) float32 losslessly, to the same bytes as `encode_float`."""
    if label.ndim == 3 or 4 * label.shape[1] > STRIP_BYTES:
        return encode_float(label)
    bits = np.ascontiguousarray(label, np.float32).view(np.uint32)
    height, width = bits.shape
    rows = min(STRIP_BYTES // (4 * width), height)
    ends = np.empty(-(-height // rows), np.int64)
    packed = np.empty(8 * bits.size + 8 * len(ends), np.uint8)
    _strips(bits, rows, packed, ends)
    strips = packed[: ends[-1] + ends[-1] % 2].copy()
    strips[ends[-1] :] = 0
    return (
        struct.pack("<2sHI", b"II", 42, 8 + len(strips))
        + strips.tobytes()
        + _directory(height, width, rows, ends, 8 + len(strips))
    )


def _directory(height: int, width: int, rows: int, ends: Array, at: int) -> bytes:
    """What a TIFF says of its strips, in the order in which OpenCV's library writes it.

    Args:
        height: Rows.
        width: Columns.
        rows: Of a strip.
        ends: (S,) of each strip, counted from the first one's start.
        at: Where the directory starts in the file.
    """
    count = len(ends)
    lengths, starts = np.diff(ends, prepend=0), 8 + np.append(0, ends[:-1])
    behind = at + 2 + 12 * 12 + 4
    where = (int(starts[0]), int(lengths[0])) if count == 1 else (behind + 4 * count, behind)
    tags = (
        (256, SHORT, 1, width),
        (257, SHORT, 1, height),
        (258, SHORT, 1, 32),  # bits a sample
        (259, SHORT, 1, 5),  # LZW
        (262, SHORT, 1, 1),  # black is zero
        (273, LONG, count, where[0]),  # starts of the strips
        (277, SHORT, 1, 1),  # samples a pixel
        (278, SHORT, 1, rows),
        (279, LONG, count, where[1]),  # lengths of the strips
        (284, SHORT, 1, 1),  # one plane
        (317, SHORT, 1, 3),  # floating-point predictor
        (339, SHORT, 1, 3),  # IEEE floating point
    )
    head = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags)
    tables = () if count == 1 else (lengths, starts)
    return head + struct.pack("<I", 0) + b"".join(x.astype("<u4").tobytes() for x in tables)


@numba.njit(cache=True, nogil=True)
def _strips(bits: Array, rows: int, packed: Array, ends: Array) -> None:
    """Compress strips of (H, W) uint32, one behind the other."""
    height, width = bits.shape
    data = np.empty(4 * rows * width, np.uint8)
    codes = np.empty(len(data) + len(data) // (FULL - FIRST) + 1, np.uint16)
    table = np.empty(SLOTS, np.uint32)
    end = 0
    for strip in range(len(ends)):
        first, last = strip * rows, min((strip + 1) * rows, height)
        for v in range(first, last):
            _predict(bits[v], data[4 * width * (v - first) :])
        count = _code(data[: 4 * width * (last - first)], table, codes)
        end = _pack(codes[:count], packed, end)
        ends[strip] = end


@numba.njit(cache=True, nogil=True)
def _predict(row: Array, data: Array) -> None:
    """Differences of the bytes of a row: all the highest ones, then the next, to the lowest."""
    width = len(row)
    before = np.uint32(0)
    for plane in range(4):
        shift = np.uint32(24 - 8 * plane)
        data[plane * width] = np.uint8((row[0] >> shift) - before)
        for u in range(1, width):
            data[plane * width + u] = np.uint8((row[u] >> shift) - (row[u - 1] >> shift))
        before = row[width - 1] >> shift


@numba.njit(cache=True, nogil=True)
def _code(data: Array, table: Array, codes: Array) -> int:
    """LZW codes of a strip without the first CLEAR and the END; returns how many.

    An entry of the table is (prefix, byte) + 1 above the 12 bits of its code; 0 is a free slot.
    """
    table[:] = 0
    count, entries = 0, FIRST
    prefix = np.int64(data[0])
    for k in range(1, len(data)):
        byte = np.int64(data[k])
        key = (prefix << 8 | byte) + 1
        slot = byte << (SLOT_BITS - 8) ^ prefix
        entry = np.int64(table[slot])
        while entry != 0 and entry >> 12 != key:
            slot = (slot + 1) & (SLOTS - 1)
            entry = np.int64(table[slot])
        if entry != 0:
            prefix = entry & 0xFFF
            continue
        codes[count] = prefix
        table[slot] = key << 12 | entries
        prefix = byte
        count, entries = count + 1, entries + 1
        if entries == FULL:
            table[:] = 0
            codes[count] = CLEAR
            count, entries = count + 1, FIRST
    codes[count] = prefix
    return count + 1


@numba.njit(cache=True, nogil=True)
def _pack(codes: Array, packed: Array, end: int) -> int:
    """Write codes in the fewest bits that their table needs, after `end`; returns the new end."""
    word, held = np.uint64(CLEAR), WIDTH_MIN
    width, entries = WIDTH_MIN, FIRST
    k = 0
    while k < len(codes):
        # As many as are equally wide; the last one before the table is emptied is CLEAR itself.
        stop = min(k + min(1 << width, FULL + 1) - entries, len(codes))
        for i in range(k, stop):
            word, held = word << np.uint64(width) | np.uint64(codes[i]), held + width
            while held >= 8:
                held -= 8
                packed[end] = np.uint8(word >> np.uint64(held))
                end += 1
        entries, k = entries + stop - k, stop
        if entries > FULL:
            width, entries = WIDTH_MIN, FIRST
        elif entries == 1 << width:
            width += 1
    if entries == FULL:
        word, held, width = word << np.uint64(width) | np.uint64(CLEAR), held + width, WIDTH_MIN
    word, held = word << np.uint64(width) | np.uint64(END), held + width
    while held > 0:
        held -= 8
        packed[end] = np.uint8(word >> np.uint64(held) if held >= 0 else word << np.uint64(-held))
        end += 1
    return end
