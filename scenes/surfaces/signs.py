"""Paint and signs: words on boards, hazard stripes, worn floor paint, drums and shutters."""

from collections.abc import Sequence

import cv2
import numpy as np

from scenes.surfaces import Shape
from scenes.surfaces.noise import blend, fractal, smoothstep, to_image
from vo.contract.arrays import Array, Image

Colour = tuple[int, int, int]


def boards(
    rng: np.random.Generator,
    texts: Sequence[str],
    shape: Shape,
    ink: Colour,
    paper: Colour,
    wear: float = 0.3,
) -> Image:
    """Letter one board for each text, framed and scuffed: (N, H, W, 3)."""
    height, width = shape
    made: list[Image] = []
    for text in texts:
        board = np.full((*shape, 3), paper, np.uint8)
        cv2.rectangle(board, (6, 6), (width - 7, height - 7), ink, max(3, height // 50))
        (w, h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
        scale = min(0.8 * width / w, 0.6 * height / h)
        at = (int((width - scale * w) / 2), int((height + scale * h) / 2))
        thick = max(2, int(2.2 * scale))
        cv2.putText(board, text, at, cv2.FONT_HERSHEY_DUPLEX, scale, ink, thick, cv2.LINE_AA)
        made.append(board)
    return worn(rng, np.stack(made), (124, 120, 112), wear)


def worn(rng: np.random.Generator, paint: Image, below: Colour, wear: float) -> Image:
    """Rub (..., H, W, 3) paint through to the colour below it: scratches, chips and dirt."""
    size = paint.shape[:-1]
    chips = fractal(rng, size, (3, 120), 1.0) + 1.2 * fractal(rng, size, (60, 900), 1.4)
    dirt = fractal(rng, size, (2, 30), 0.5)
    colour = paint * (1 + 0.05 * dirt)[..., None]
    ground = np.asarray(below) * (1 + 0.09 * fractal(rng, size, (2, 12), 0.2))[..., None]
    low = 2.6 - 2.6 * wear
    return to_image(blend(colour, ground, smoothstep(low, low + 0.5, chips)))


def worn_paint(rng: np.random.Generator, shape: Shape, rgb: Colour, wear: float) -> Image:
    """Draw floor paint rubbed through to concrete: (H, W, 3)."""
    return worn(rng, np.full((*shape, 3), rgb, np.uint8), (126, 122, 114), wear)


def stripes(
    rng: np.random.Generator, shape: Shape, colours: tuple[Colour, Colour], width_px: int
) -> Image:
    """Paint slanting stripes, a little worn: (H, W, 3), tiling if both sides are even periods."""
    v, u = np.mgrid[: shape[0], : shape[1]]
    first = ((u + v) // width_px % 2 == 0)[..., None]
    return worn(rng, np.where(first, colours[0], colours[1]).astype(np.uint8), (96, 94, 90), 0.25)


def drums(rng: np.random.Generator, tones: Sequence[Colour], shape: Shape) -> Image:
    """Draw the skins of steel drums, unrolled: hoops, a label, runs of rust: (N, H, W, 3)."""
    height, width = shape
    skins: list[Array] = []
    for tone in tones:
        dents = fractal(rng, shape, (20, 300), 1.3)
        skin = np.asarray(tone) * (1 + 0.06 * dents)[..., None]
        v = np.arange(height)[:, None] / height
        hoop = sum(np.exp(-(((v - at) / 0.012) ** 2)) for at in (0.03, 0.34, 0.66, 0.97))
        skin = skin * (1 + 0.35 * np.asarray(hoop))[..., None]
        rust = smoothstep(0.8, 2.2, fractal(rng, shape, (3, 200), 1.0) + 0.8 * (v > 0.9))
        image = to_image(blend(skin, (112, 70, 44), 0.7 * rust))
        for start in (0.1, 0.6):
            u = int(start * width)
            corner, far = (u, int(0.4 * height)), (u + width // 5, int(0.62 * height))
            cv2.rectangle(image, corner, far, (222, 218, 204), -1)
            for row in range(corner[1] + 8, far[1] - 6, 8):
                end = far[0] - int(rng.integers(6, width // 9))
                cv2.line(image, (u + 6, row), (end, row), (52, 50, 50), 2)
        skins.append(image)
    return np.stack(skins)


def shutter(rng: np.random.Generator, shape: Shape, rgb: Colour) -> Image:
    """Draw a roller shutter's slats, about 80 mm each over 2.5 m, grimy below: (H, W, 3)."""
    v = np.arange(shape[0])[:, None] / shape[0]
    bulge = np.cos(2 * np.pi * 32 * v)
    streak = fractal(rng, shape, (3, 400), 1.1, stretch=0.2)
    colour = np.asarray(rgb) * (1 + 0.16 * bulge + 0.05 * streak)[..., None]
    grime = smoothstep(0.6, 2.4, fractal(rng, shape, (4, 500), 1.2) + 2.0 * (2 * v - 1))
    return to_image(blend(colour, (84, 78, 70), 0.6 * grime))


def grate(side_px: int) -> Image:
    """Draw a drain's iron grating with its frame: (S, S, 3)."""
    v, u = np.mgrid[:side_px, :side_px] / side_px
    bars = np.cos(2 * np.pi * 12 * u) > -0.2
    rim = np.maximum(np.abs(u - 0.5), np.abs(v - 0.5)) > 0.44
    iron = (bars | rim | (np.abs(v - 0.5) < 0.03))[..., None]
    return np.where(iron, (96, 92, 88), (26, 26, 28)).astype(np.uint8)


def traffic_signs(side_px: int) -> Image:
    """Draw a warning, a ban on parking and a limit of speed, each to its rim: (3, S, S, 3)."""
    signs = np.full((3, side_px, side_px, 3), 238, np.uint8)
    red, middle = (186, 34, 40), (side_px // 2, side_px // 2)
    radius, stroke = int(0.49 * side_px), side_px // 10
    turn = np.pi / 2 + 2 * np.pi * np.arange(3) / 3
    corners = side_px * (0.5 + 0.46 * np.stack([np.cos(turn), -np.sin(turn)], axis=-1))
    cv2.polylines(signs[0], [corners.round().astype(np.int32)], True, red, stroke)
    cv2.rectangle(signs[0], (middle[0] - 5, middle[1] - 22), (middle[0] + 5, middle[1] + 16), 0, -1)
    signs[1] = (34, 66, 150)
    ends = np.array([(0.18, 0.18), (0.82, 0.82)]) * side_px
    cv2.line(signs[1], tuple(ends[0].astype(int)), tuple(ends[1].astype(int)), red, stroke)
    for sign in signs[1:]:
        cv2.circle(sign, middle, radius - stroke // 2, red, stroke)
    font, at = cv2.FONT_HERSHEY_DUPLEX, (int(0.22 * side_px), int(0.64 * side_px))
    cv2.putText(signs[2], "30", at, font, side_px / 75, (20, 20, 20), side_px // 26, cv2.LINE_AA)
    return signs
