"""Images of many codecs and depths, and damaged ones."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from folders import HEIGHT, PERIOD_NS, WIDTH, wall, write_euroc

from vo.contract.errors import ImageError
from vo.contract.remarks import Remark
from vo.recordings.images import grey_reader, read_grey
from vo.recordings.readers import open_sequence

IMAGE = wall(1)[0][0]


def deepen(folder, shift, eyes=(0, 1)):
    """Store the images of a recording with 16 bits a pixel, levels times 2^shift."""
    for eye in eyes:
        for path in (folder / "mav0" / f"cam{eye}" / "data").iterdir():
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16) << shift
            cv2.imwrite(str(path), image)


@pytest.mark.parametrize(("shift", "bits"), [(0, 8), (2, 10), (4, 12), (6, 14), (8, 16)])
def test_sixteen_bits_are_scaled_by_the_depth_in_use(tmp_path, shift, bits):
    folder = write_euroc(tmp_path / "d", wall(3))
    deepen(folder, shift)
    with pytest.warns(
        Remark, match=f"of which {bits} are in use; levels are divided by {2**shift}"
    ):
        sequence = open_sequence(folder)
    for frame, (left, right) in zip(sequence, wall(3), strict=True):
        assert (frame.left == left).all()
        assert (frame.right == right).all()


def test_deep_images_among_others_are_said(tmp_path):
    folder = write_euroc(tmp_path / "d", wall(2))
    path = folder / "mav0" / "cam0" / "data" / f"{2 * PERIOD_NS}.png"
    cv2.imwrite(str(path), wall(2)[1][0].astype(np.uint16) << 8)
    sequence = open_sequence(folder)
    with pytest.warns(Remark, match="images of 8 and of 16 bits"):
        assert (sequence[1].left == wall(2)[1][0]).all()


def test_deep_images_of_one_eye_are_scaled_alone(tmp_path):
    folder = write_euroc(tmp_path / "d", wall(2))
    deepen(folder, 4, eyes=[1])
    with pytest.warns(Remark, match="of which 12 are in use"):
        sequence = open_sequence(folder)
    assert (sequence[1].left == wall(2)[1][0]).all()
    assert (sequence[1].right == wall(2)[1][1]).all()


def test_depth_in_use_is_that_of_the_sequence(tmp_path):
    folder = write_euroc(tmp_path / "d", [(IMAGE // 16, IMAGE // 16), (IMAGE, IMAGE)])
    deepen(folder, 4)
    with pytest.warns(Remark, match="of which 12 are in use"):
        sequence = open_sequence(folder)
    assert (sequence[0].left == IMAGE // 16).all()  # a dark frame stays dark


def test_levels_above_the_depth_in_use_are_clipped(tmp_path):
    image = np.full((20, 30), 1000, np.uint16)
    names = [str(tmp_path / f"{k}.png") for k in range(2)]
    cv2.imwrite(names[0], image)
    cv2.imwrite(names[1], 2 * image)
    with pytest.warns(Remark, match="10 are in use"):
        read = grey_reader([tmp_path / "0.png"])
    with pytest.warns(Remark, match="100% of the pixels exceed 10 bits"):
        assert (read(tmp_path / "1.png") == 255).all()


@pytest.mark.parametrize("suffix", [".jpg", ".JPEG", ".jp2", ".bmp", ".pgm", ".tif", ".webp"])
def test_codecs_are_read_with_and_without_suffix_in_the_table(tmp_path, suffix):
    folder = write_euroc(tmp_path / "d", wall(2))
    for eye in (0, 1):
        camera = folder / "mav0" / f"cam{eye}"
        for path in sorted((camera / "data").iterdir()):
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            path.unlink()
            encoded = cv2.imencode(suffix.lower(), image)[1]
            path.with_suffix(suffix).write_bytes(encoded.tobytes())
        table = camera / "data.csv"
        table.write_text(table.read_text().replace(".png", suffix if eye else ""))
    difference = open_sequence(folder)[1].left.astype(int) - wall(2)[1][0]
    assert np.abs(difference).mean() < 5


@pytest.mark.parametrize("prefix", ["data/", "cam0\\data\\", ""])
def test_names_with_a_folder_or_another_suffix_are_found(tmp_path, prefix):
    folder = write_euroc(tmp_path / "d", wall(2))
    for eye in (0, 1):
        table = folder / "mav0" / f"cam{eye}" / "data.csv"
        text = table.read_text().replace(".png", ".JPG" if prefix == "" else ".png")
        table.write_text(text.replace(",", f",{prefix}"))
    assert (open_sequence(folder)[1].left == wall(2)[1][0]).all()


def test_names_of_finder_and_windows_are_no_images(tmp_path):
    folder = tmp_path / "k"
    for eye in (0, 1):
        (folder / f"image_{eye}").mkdir(parents=True)
        cv2.imwrite(str(folder / f"image_{eye}" / "000000.png"), IMAGE)
        (folder / f"image_{eye}" / "._000000.png").write_bytes(b"junk")
        (folder / f"image_{eye}" / "Thumbs.db").write_bytes(b"junk")
    P0 = "100 0 99 0 0 100 99 0 0 0 1 0"
    (folder / "calib.txt").write_text(f"P0: {P0}\nP1: {P0.replace('99 0 0 100', '99 -9 0 100')}\n")
    (folder / "times.txt").write_text("0\n")
    assert len(open_sequence(folder)) == 1


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


PNG = cv2.imencode(".png", IMAGE)[1].tobytes()
JPG = cv2.imencode(".jpg", IMAGE)[1].tobytes()
FLIPPED = PNG[: len(PNG) // 2] + bytes([PNG[len(PNG) // 2] ^ 1]) + PNG[len(PNG) // 2 + 1 :]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS"),
        (PNG[:-30], "the PNG is truncated or damaged"),
        (FLIPPED, "the PNG is truncated or damaged"),
        (JPG[: len(JPG) // 2], "the JPEG is truncated"),
        (JPG[:-400] + JPG[-2:], "Corrupt JPEG data: premature end of data segment"),
        (cv2.imencode(".tif", IMAGE.astype(np.float32))[1].tobytes(), "float32; expected 8 or 16"),
        (b"<html>404</html>", "not a readable image"),
    ],
)
def test_damaged_images_are_refused(tmp_path, data, message):
    path = tmp_path / "x.png"
    path.write_bytes(data)
    with pytest.raises(ImageError, match=f"x.png: .*{message}"):
        read_grey(path)


def test_bytes_after_the_end_of_an_image_do_no_harm(tmp_path):
    for name, data in (("x.png", PNG), ("x.jpg", JPG)):
        (tmp_path / name).write_bytes(data + b"\0" * 100)
        assert read_grey(tmp_path / name).shape == (HEIGHT, WIDTH)
    (tmp_path / "y.jpg").write_bytes(JPG[:-2] + bytes(20) + JPG[-2:])
    with pytest.warns(Remark, match="JPEGs hold bytes after the image was complete"):
        read_grey(tmp_path / "y.jpg")
    (tmp_path / "y.png").write_bytes(PNG[:-12] + chunk(b"tEXt", b"a\0b") + PNG[-12:])
    assert (read_grey(tmp_path / "y.png") == IMAGE).all()


def test_first_image_may_be_damaged(tmp_path):
    folder = write_euroc(tmp_path / "d", wall(3))
    (folder / "mav0" / "cam0" / "data" / f"{PERIOD_NS}.png").write_bytes(b"")
    assert len(open_sequence(folder)) == 3
