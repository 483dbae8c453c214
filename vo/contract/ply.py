"""PLY files of points."""

from pathlib import Path

from vo.contract.arrays import Array
from vo.contract.files import replacing

TYPES = {"<f4": "float", "|u1": "uchar", "<i4": "int"}
"""NumPy's types and PLY's."""


def write_ply(path: Path, table: Array) -> None:
    """Write points, rows of a structured array, as a binary PLY; each field is a property.

    Raises:
        DatasetError: If the file cannot be written.
    """
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property {TYPES[table.dtype[x].str]} {x}" for x in table.dtype.names or ()]
    with replacing(path) as partial, partial.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        file.write(table.tobytes())
