"""Times of the images of one eye: of a table, or of the names of the files."""

from pathlib import Path

from vo.contract.arrays import Indices
from vo.contract.errors import DatasetError
from vo.contract.remarks import remark
from vo.recordings.images import image_files, list_images
from vo.recordings.tables import NS, Table, read_table


def read_image_times(
    table: Path, images: Path, row: str, time: int, unit_ns: int
) -> tuple[Indices, list[Path]]:
    """Read the times (N,) in ns of the images in a folder, and their files, which may be missing.

    Without the table, names such as `1403636579763555584.png` are timestamps, which is remarked.

    Args:
        table: Rows with the time and the name of an image in the first two columns.
        images: Folder of the images.
        row: The columns of a row, for errors.
        time: Index of the column of times, 0 or 1.
        unit_ns: Unit of times where nothing else shows it.

    Raises:
        DatasetError: If the table is malformed, times do not increase, or images are repeated.
    """
    if not table.is_file() and (files := list_images(images)):
        remark(f"{table}: missing; the names of {len(files)} images are taken for timestamps")
        stems = sorted((x.stem for x in files), key=lambda x: (len(x.partition(".")[0]), x))
        rows = tuple((x, x) for x in stems)
        found = Table(images, (), None, tuple(range(1, len(rows) + 1)), rows, DatasetError)
        row, time, unit_ns = "names of images that are timestamps", 0, NS
    else:
        found = read_table(table)
    if not len(found):
        raise DatasetError(f"{table}: holds no rows; expected {row}")
    stamps, names = found.stamps(time, row), found.words(1 - time, row)
    first = {name: i for i, name in reversed(list(enumerate(names)))}
    for i, name in enumerate(names):
        if first[name] != i:
            raise found.fault(i, f"{name} is the image of line {found.lines[first[name]]}, too")
    times = found.in_ns(stamps, found.unit_ns(stamps, unit_ns))
    found.require_increasing(times)
    return times, image_files(images, names)
