"""Printed surfaces: posters, book spines, screens, keyboards, cartons, signs, paintings."""

import itertools

import cv2
import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, ramp, smoothstep, to_image
from vo.contract.arrays import Array, Image

WORDS = (
    "FIELD NOTES", "OPEN DAY", "MAPS", "SAFETY FIRST", "ROBOTS", "CITY WALK", "LIBRARY",
    "SUMMER", "GEOMETRY", "WORKSHOP", "HARBOUR", "NIGHT BUS", "ATLAS", "ORCHARD",
)  # fmt: skip
INKS = (
    (176, 62, 48), (44, 84, 124), (222, 176, 74), (62, 108, 82), (72, 62, 96),
    (214, 206, 190), (48, 50, 56), (190, 124, 84), (126, 160, 170),
)  # fmt: skip
FONT = cv2.FONT_HERSHEY_DUPLEX


def posters(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw posters with a picture, a headline and small print: (count, H, W, 3)."""
    return np.stack([_poster(rng, shape) for _ in range(count)])


def _poster(rng: np.random.Generator, shape: Shape) -> Image:
    height, width = shape
    paper, ink, other = (np.array(INKS[i]) for i in rng.permutation(len(INKS))[:3])
    sheet = np.ones((*shape, 3)) * (0.35 * paper + 0.65 * np.array([226, 222, 212]))
    top, bottom = int(0.08 * height), int(0.62 * height)
    left, right = int(0.08 * width), int(0.92 * width)
    scene = fractal(rng, (bottom - top, right - left), (3, 240), 1.3)
    bands = np.round(scene * 2) / 2 if rng.random() < 0.5 else scene
    sheet[top:bottom, left:right] = ramp((ink, other, paper * 0.5 + 110), 0.5 + 0.25 * bands)
    canvas = to_image(sheet)
    colour = tuple(int(c) for c in ink * 0.7)
    headline = WORDS[rng.integers(len(WORDS))]
    scale = 0.84 * width / cv2.getTextSize(headline, FONT, 1.0, 2)[0][0]
    foot = (left, int(0.74 * height))
    cv2.putText(canvas, headline, foot, FONT, min(scale, 0.006 * height), colour, 3, cv2.LINE_AA)
    _small_print(rng, canvas, (left, int(0.80 * height), right, int(0.95 * height)), colour)
    return canvas


def _small_print(
    rng: np.random.Generator, canvas: Image, window: tuple[int, ...], colour: tuple[int, ...]
) -> None:
    """Set lines of word-like dashes into the window u0, v0, u1, v1 of a canvas."""
    u0, v0, u1, v1 = window
    for v in range(v0, v1, 7):
        u = u0
        while u < u1 - 4:
            word = int(rng.integers(4, 22))
            cv2.line(canvas, (u, v), (min(u + word, u1), v), colour, 2, cv2.LINE_AA)
            u += word + 5


def book_rows(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw rows of book and folder spines, at 1.5 mm per texel: (count, H, W, 3)."""
    return np.stack([_book_row(rng, shape) for _ in range(count)])


def _book_row(rng: np.random.Generator, shape: Shape) -> Image:
    height, width = shape
    row = np.full((*shape, 3), 34, dtype=np.uint8)
    u = 0
    while u < width:
        thick = int(rng.integers(9, 40))
        tall = int(rng.uniform(0.66, 0.95) * height)
        base = 0.75 * np.array(INKS[rng.integers(len(INKS))]) * rng.uniform(0.7, 1.1) + 28
        spine = row[height - tall :, u : u + thick - 1]
        round_off = 1 - 0.35 * np.linspace(-1, 1, spine.shape[1]) ** 2
        wear = 1 + 0.05 * rng.standard_normal((tall, 1))
        spine[:] = to_image(base * (round_off * wear)[..., None])
        label = tuple(int(c) for c in (230 - base * 0.3 if base.mean() < 140 else base * 0.25))
        for v in range(int(0.12 * tall), int(rng.uniform(0.4, 0.85) * tall), 6):
            inset = int(rng.integers(2, max(3, thick // 3)))
            cv2.line(spine, (inset, v), (max(inset, thick - 2 - inset), v), label, 2)
        if rng.random() < 0.4:
            band = int(rng.uniform(0.1, 0.9) * tall)
            spine[band : band + 8] = INKS[rng.integers(len(INKS))]
        u += thick
    return row


def screens(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw monitors showing an editor and a chart: (count, H, W, 3)."""
    pictures: list[Image] = []
    for _ in range(count):
        canvas = np.full((*shape, 3), (38, 42, 48), dtype=np.uint8)
        height, width = shape
        for v in range(14, height - 8, 9):
            u = 12 + 14 * int(rng.integers(0, 4))
            for _ in range(int(rng.integers(1, 6))):
                word = int(rng.integers(8, 36))
                ink = INKS[rng.integers(len(INKS))]
                soft = tuple(int(0.5 * c + 90) for c in ink)
                cv2.line(canvas, (u, v), (min(u + word, width // 2), v), soft, 3)
                u += word + 7
        cv2.rectangle(canvas, (width // 2 + 14, 14), (width - 14, height - 14), (214, 214, 208), -1)
        rise = np.cumsum(rng.standard_normal(60))
        x = np.linspace(width // 2 + 24, width - 24, 60)
        y = height / 2 - rise / np.ptp(rise) * height * 0.6
        line = np.stack([x, np.clip(y, 20, height - 20)], axis=1).astype(np.int32)
        cv2.polylines(canvas, [line], False, (176, 62, 48), 2, cv2.LINE_AA)
        pictures.append(canvas)
    return np.stack(pictures)


def keyboard(shape: Shape = (96, 288)) -> Image:
    """Draw a keyboard from above: (H, W, 3)."""
    height, width = shape
    board = np.full((*shape, 3), (44, 46, 50), dtype=np.uint8)
    for row in range(5):
        for column in range(15):
            u, v = 8 + column * (width - 16) // 15, 8 + row * (height - 16) // 5
            cv2.rectangle(board, (u, v), (u + 14, v + 12), (78, 80, 84), -1)
            cv2.circle(board, (u + 5, v + 6), 2, (190, 190, 190), -1)
    return board


def cartons(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw sides of cardboard boxes with tape, label and a mark: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    tone = 1 + 0.03 * fractal(rng, size, (2, 12), 0.2) + 0.05 * fractal(rng, size, (20, 300), 1.4)
    flutes = 0.015 * np.sin(np.arange(side_px) * 2 * np.pi / 6)
    tint = np.array([172, 142, 108]) * rng.uniform(0.85, 1.1, (count, 1, 1, 1))
    board = tint * (tone + flutes)[..., None]
    scuff = smoothstep(1.5, 2.6, fractal(rng, size, (4, 80), 1.1))
    sides = to_image(blend(board, (206, 180, 146), 0.5 * scuff))
    for side in sides:
        _label_carton(rng, side)
    return sides


def _label_carton(rng: np.random.Generator, side: Image) -> None:
    """Tape, label and stamp one (S, S, 3) carton in place."""
    s = len(side)
    tape = slice(int(0.46 * s), int(0.56 * s))
    side[:, tape] = to_image(side[:, tape] * 0.75 + np.array([52, 44, 30]))
    u, v = (int(x) for x in rng.integers(int(0.05 * s), int(0.55 * s), 2))
    cv2.rectangle(side, (u, v), (u + s // 3, v + s // 4), (214, 212, 204), -1)
    _small_print(rng, side, (u + 8, v + 10, u + s // 3 - 8, v + s // 6), (50, 50, 52))
    for x in range(u + 8, u + s // 3 - 10, 3):  # bar code
        if rng.random() < 0.55:
            cv2.line(side, (x, v + s // 5), (x, v + s // 4 - 4), (40, 40, 40), 1)
    word, foot = WORDS[rng.integers(len(WORDS))], (int(0.06 * s), int(0.93 * s))
    size, thin = 0.8 * s / 256 * 0.5, cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(side, word, foot, thin, size, (70, 56, 44), 2, cv2.LINE_AA)


def notes(rng: np.random.Generator, shape: Shape) -> Image:
    """Draw a used whiteboard: wiped traces, a diagram and sticky notes: (H, W, 3)."""
    height, width = shape
    wiped = smoothstep(0.6, 2.2, fractal(rng, shape, (8, 300), 1.3, stretch=2.0))
    board: Array = blend(np.ones((*shape, 3)) * (222, 224, 222), (186, 192, 200), 0.6 * wiped)
    canvas = to_image(board)
    spots = rng.integers((20, 20), (width - 90, height - 60), (7, 2))
    for a, b in itertools.pairwise(spots):
        ink = INKS[rng.integers(5)]
        u, v = (int(x) for x in a)
        cv2.arrowedLine(canvas, (u + 35, v + 20), (int(b[0]), int(b[1])), ink, 2, cv2.LINE_AA)
        cv2.rectangle(canvas, (u, v), (u + 70, v + 40), ink, 2, cv2.LINE_AA)
        _small_print(rng, canvas, (u + 8, v + 12, u + 62, v + 34), ink)
    for _ in range(10):
        u, v = (int(x) for x in rng.integers((10, 10), (width - 50, height - 50)))
        paper = ((226, 206, 112), (216, 164, 150), (168, 200, 168))[rng.integers(3)]
        cv2.rectangle(canvas, (u, v), (u + 36, v + 36), paper, -1)
        _small_print(rng, canvas, (u + 4, v + 9, u + 32, v + 30), (70, 70, 76))
    return canvas


def door_signs(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw number plates of rooms with names below: (count, S, S, 3)."""
    plates = np.full((count, side_px, side_px, 3), (226, 228, 228), dtype=np.uint8)
    floor = int(rng.integers(1, 5))
    s = side_px / 160
    for k, plate in enumerate(plates):
        number = f"{floor}.{2 * k + int(rng.integers(2)):02d}"
        cv2.rectangle(plate, (0, 0), (side_px, int(12 * s)), (60, 84, 112), -1)
        foot, thick = (int(18 * s), int(78 * s)), max(1, round(3 * s))
        cv2.putText(plate, number, foot, FONT, 1.6 * s, (40, 44, 50), thick, cv2.LINE_AA)
        window = (int(18 * s), int(104 * s), int(140 * s), int(140 * s))
        _small_print(rng, plate, window, (70, 72, 78))
    return plates


def pictograms(side_px: int) -> Image:
    """Draw the signs for a fire extinguisher and for the way out: (2, S, S, 3)."""
    s = side_px
    fire = np.full((s, s, 3), (170, 34, 32), dtype=np.uint8)
    white = (232, 234, 232)
    cv2.rectangle(fire, (int(0.3 * s), int(0.35 * s)), (int(0.5 * s), int(0.85 * s)), white, -1)
    cv2.line(fire, (int(0.4 * s), int(0.22 * s)), (int(0.4 * s), int(0.35 * s)), white, s // 16)
    cv2.line(fire, (int(0.4 * s), int(0.25 * s)), (int(0.62 * s), int(0.5 * s)), white, s // 24)
    flame = np.array([(0.72, 0.45), (0.85, 0.7), (0.76, 0.86), (0.62, 0.86), (0.6, 0.68)])
    cv2.fillPoly(fire, [(flame * s).astype(np.int32)], white)
    out = np.full((s, s, 3), (30, 128, 84), dtype=np.uint8)
    cv2.rectangle(out, (int(0.68 * s), int(0.15 * s)), (int(0.9 * s), int(0.85 * s)), white, -1)
    tail, head = (int(0.12 * s), int(0.5 * s)), (int(0.58 * s), int(0.5 * s))
    cv2.arrowedLine(out, tail, head, white, s // 10, cv2.LINE_AA, tipLength=0.45)
    return np.stack([fire, out])


def paintings(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Paint landscapes, fields of colour and abstract swirls in turn: (count, H, W, 3)."""
    painters = (_landscape, _colour_field, _swirls)
    return np.stack([painters[k % 3](rng, shape) for k in range(count)])


def _landscape(rng: np.random.Generator, shape: Shape) -> Image:
    """Paint ranges of hills, darker the nearer, under a washed sky."""
    height, width = shape
    strokes = fractal(rng, shape, (3, 40), 0.6, stretch=3.0)
    down = np.linspace(0, 1, height)[:, None]
    low, high = (np.array(INKS[k]) for k in rng.permutation(len(INKS))[:2])
    colour = ramp((0.5 * high + 100, 0.3 * low + 160), down + 0.06 * strokes)
    for k, base in enumerate(np.linspace(0.45, 0.85, 4)):
        ridge = base + 0.05 * fractal(rng, (8, width), (20, 600), 1.2)[0]
        tone = (1.1 - 0.22 * k) * (0.6 * low + 0.25 * high)
        hill = tone * (1 + 0.12 * strokes)[..., None]
        colour = blend(colour, hill, smoothstep(0, 0.012, down - ridge))
    return to_image(colour)


def _colour_field(rng: np.random.Generator, shape: Shape) -> Image:
    """Paint soft-edged rectangles and lines on a ground."""
    height, width = shape
    canvas = np.full((*shape, 3), INKS[rng.integers(len(INKS))], np.uint8)
    for _ in range(int(rng.integers(5, 10))):
        u, v = (int(x) for x in rng.uniform((0, 0), (0.8 * width, 0.8 * height)))
        du, dv = (int(x) for x in rng.uniform((0.08, 0.08), (0.5, 0.5)) * (width, height))
        ink = INKS[rng.integers(len(INKS))]
        cv2.rectangle(canvas, (u, v), (u + du, v + dv), ink, -1 if rng.random() < 0.7 else 5)
    brush = fractal(rng, shape, (3, 60), 0.6, stretch=2.0)
    return to_image(canvas * (1 + 0.06 * brush)[..., None])


def _swirls(rng: np.random.Generator, shape: Shape) -> Image:
    """Paint bands of colour that follow the contours of noise."""
    relief = fractal(rng, shape, (30, 500), 1.6)
    inks = [np.array(INKS[k]) for k in rng.permutation(len(INKS))[:4]]
    bands = 0.5 + 0.5 * np.sin(5 * relief + 0.5 * fractal(rng, shape, (4, 60), 0.8))
    return to_image(ramp(inks, bands) * (1 + 0.05 * fractal(rng, shape, (2, 20), 0.4))[..., None])


def marble(rng: np.random.Generator, side_px: int, rgb: Rgb) -> Image:
    """Draw veined, polished stone: (S, S, 3), tiling."""
    size = (side_px, side_px)
    vein = np.abs(fractal(rng, size, (8, side_px), 1.5))
    cloud = fractal(rng, size, (20, side_px), 1.3)
    colour = np.asarray(rgb) * (1 + 0.04 * cloud)[..., None]
    return to_image(blend(colour, np.asarray(rgb) * 0.6, 0.6 * smoothstep(0.12, 0.0, vein)))
