"""Fronts of measuring instruments, wraps of bottles, covers of drawers in a laboratory."""

import cv2
import numpy as np

from scenes.surfaces import Shape
from scenes.surfaces.noise import fractal, to_image
from scenes.surfaces.prints import INKS
from scenes.surfaces.timber import painted
from vo.contract.arrays import Image

Colour = tuple[int, int, int]
CASES = ((196, 194, 184), (72, 76, 82), (150, 158, 164), (204, 200, 176))


def fronts(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw instrument fronts: a screen or a display, knobs, keys and sockets: (count, H, W, 3)."""
    return np.stack([_front(rng, shape) for _ in range(count)])


def _front(rng: np.random.Generator, shape: Shape) -> Image:
    height, width = shape
    case = np.array(CASES[rng.integers(len(CASES))])
    front = to_image(case * (1 + 0.02 * fractal(rng, shape, (2, 200), 1.0))[..., None])
    ink = (210, 210, 204) if case.mean() < 110 else (44, 46, 50)
    cv2.rectangle(front, (3, 3), (width - 4, height - 4), ink, 1)
    right = int(rng.uniform(0.45, 0.62) * width)
    _screen(rng, front[int(0.1 * height) : int(0.68 * height), int(0.05 * width) : right])
    for v in np.linspace(0.16, 0.62, 3) * height:
        for u in np.linspace(right + 0.1 * width, 0.92 * width, 3):
            _control(rng, front, (int(u), int(v)), height, ink)
    for u in np.linspace(0.1, 0.9, int(rng.integers(4, 8))) * width:
        spot = (int(u), int(0.84 * height))
        cv2.circle(front, spot, height // 18, (34, 34, 36), -1, cv2.LINE_AA)
        ring = ((176, 62, 48), (188, 186, 178), (44, 84, 124))[rng.integers(3)]
        cv2.circle(front, spot, height // 18, ring, 2, cv2.LINE_AA)
    return front


def _screen(rng: np.random.Generator, window: Image) -> None:
    """Fill a (H, W, 3) window with traces on a grid, or with digits."""
    height, width = window.shape[:2]
    window[:] = (22, 34, 32)
    if rng.random() < 0.7:
        for k in range(1, 8):
            cv2.line(window, (k * width // 8, 0), (k * width // 8, height), (52, 72, 66), 1)
            cv2.line(window, (0, k * height // 8), (width, k * height // 8), (52, 72, 66), 1)
        t = np.linspace(0, 1, 80)
        for glow in ((226, 214, 92), (92, 206, 226)):
            wave = np.sin(2 * np.pi * rng.uniform(1, 5) * t + rng.uniform(0, 6))
            wave = 0.5 + 0.32 * wave * rng.uniform(0.4, 1) + 0.01 * rng.standard_normal(80)
            line = np.column_stack([t * width, wave * height]).astype(np.int32)
            cv2.polylines(window, [line], False, glow, 2, cv2.LINE_AA)
    else:
        text = f"{rng.uniform(0, 99):06.3f}"
        scale = 0.8 * width / cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 3)[0][0]
        place = (int(0.1 * width), int(0.65 * height))
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(window, text, place, font, scale, (226, 92, 72), 3, cv2.LINE_AA)


def _control(
    rng: np.random.Generator,
    front: Image,
    spot: tuple[int, int],
    height: int,
    ink: tuple[int, int, int],
) -> None:
    """Put a knob or a key with a caption."""
    u, v = spot
    size = height // 14
    if rng.random() < 0.5:
        cv2.circle(front, spot, size, (48, 50, 54), -1, cv2.LINE_AA)
        angle = rng.uniform(0, 6.28)
        tip = (int(u + size * np.cos(angle)), int(v + size * np.sin(angle)))
        cv2.line(front, spot, tip, (220, 220, 214), 2, cv2.LINE_AA)
    else:
        paint = INKS[rng.integers(len(INKS))]
        cv2.rectangle(front, (u - size, v - size // 2), (u + size, v + size // 2), paint, -1)
    cv2.line(front, (u - size, v + size + 4), (u + size // 2, v + size + 4), ink, 1)


def wraps(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw the skins of bottles and cans, unrolled, with labels: (count, H, W, 3)."""
    height, width = shape
    skins = np.empty((count, *shape, 3), np.uint8)
    for skin in skins:
        stuff = np.array(((120, 74, 36), (206, 210, 206), (150, 176, 170), (60, 92, 136)))
        skin[:] = to_image(stuff[rng.integers(4)] * (1 + 0.03 * rng.standard_normal((*shape, 1))))
        top, bottom = int(0.35 * height), int(0.85 * height)
        for left in (int(0.05 * width), int(0.55 * width)):
            right = left + int(0.38 * width)
            cv2.rectangle(skin, (left, top), (right, bottom), (228, 226, 216), -1)
            band = INKS[rng.integers(len(INKS))]
            cv2.rectangle(skin, (left, top), (right, top + height // 8), band, -1)
            for v in range(top + height // 5, bottom - 4, 6):
                end = right - int(rng.integers(3, width // 5))
                cv2.line(skin, (left + 4, v), (end, v), (60, 60, 64), 1)
    return skins


def breadboard(rng: np.random.Generator) -> Image:
    """Draw a board for optics with a hole every 25 mm, 0.25 m wide: (256, 256, 3), tiling."""
    v, u = np.mgrid[:256, :256] / 25.6 % 1 - 0.5
    board = painted(rng, (256, 256), (92, 94, 98))
    return np.where((np.hypot(u, v) < 0.16)[..., None], 26, board).astype(np.uint8)
