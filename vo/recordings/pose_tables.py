"""Columns of poses in a text table: which is which, and the poses in them."""

import re
from dataclasses import dataclass

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.remarks import remark
from vo.recordings.tables import NS, Table

TIME = re.compile(r"(time|stamp|timestamps?|t)(_?([mun]?s|[mun]?sec))?")
POSITION = re.compile(
    r"(?:p|t|pos|position|trans|translation|pose|p_\w+_)?_?([xyz])(?:_m)?"
    r"|.*(?:position|translation)[._]([xyz])"
)
ROTATION = re.compile(
    r"(?:q|r|quat|quaternion|rot|rotation|ori|orientation|q_\w+_)_?([wxyz])"
    r"|.*(?:orientation|rotation)[._]([wxyz])"
)
OF = re.compile(r" of .*")
"""What follows a name in a header, such as `y of the tracked point`."""
GROUPS = (
    (re.compile(r"(q|quat|quaternion|orientation|rotation)(\(wxyz\))"), ("qw", "qx", "qy", "qz")),
    (re.compile(r"q|quat|quaternion|orientation|rotation|q_\w+to\w+"), ("qx", "qy", "qz", "qw")),
    (re.compile(r"p|pos|position|p_\w+in\w+"), ("px", "py", "pz")),
)
"""One name for several columns: OpenVINS writes states as `timestamp q_GtoI p_IinG v_IinG …`."""

MAX_LENGTH_ERROR = 0.05
"""Largest difference of a quaternion's length from 1: digits that were cut off."""

MAX_ROTATION_ERROR = 0.02
"""Largest entry of R R^T - I of a rotation that was written with few digits."""

MAX_POSITION_M = 1e9
"""Largest coordinate: those of the Earth are below 1e7 m."""


@dataclass(frozen=True)
class PoseColumns:
    """Indices of the columns of time, position and quaternion, scalar first; None without one.

    Positions of two columns are in a plane, z = 0.
    """

    time: int
    position: tuple[int, ...]
    quat_wxyz: tuple[int, ...] | None

    def poses(self, table: Table, expected: str) -> Array:
        """Return the poses (N, 4, 4) of the rows; without rotation, that is the identity.

        Raises:
            DriftyardError: If a number is missing or not finite, or a quaternion is not of unit
                length; of the table's class, names file and line.
        """
        positions = np.zeros((len(table), 3))
        positions[:, : len(self.position)] = table.numbers(self.position, expected)
        for i in np.flatnonzero((np.abs(positions) > MAX_POSITION_M).any(axis=1)):
            raise table.fault(int(i), f"a position is beyond 1e9 m; expected {expected}")
        if self.quat_wxyz is None:
            return se3.pose(np.eye(3), positions)
        quat_wxyz = table.numbers(self.quat_wxyz, expected)
        lengths = np.linalg.norm(quat_wxyz, axis=1)
        for i in np.flatnonzero(np.abs(lengths - 1) > MAX_LENGTH_ERROR):
            message = (
                f"the quaternion has length {lengths[i]:.3g} instead of 1; expected {expected}"
            )
            raise table.fault(int(i), message)
        return se3.from_quat_wxyz(quat_wxyz, positions)


TUM = PoseColumns(0, (1, 2, 3), (7, 4, 5, 6))
EUROC = PoseColumns(0, (1, 2, 3), (4, 5, 6, 7))


def named_columns(table: Table) -> PoseColumns | None:
    """Find the columns by the names in a header; None unless time and position are named."""
    columns = max((len(row) for row in table.rows), default=0)
    leading = table.separator is None
    return next(filter(None, (_columns(x, columns, leading) for x in table.headers)), None)


def unnamed_columns(table: Table, unit_ns: int, usual: PoseColumns) -> PoseColumns:
    """Return EuRoC's columns for commas and ns, TUM's for blanks and s, else the usual ones.

    Separators that are unusual bring a remark.
    """
    has_commas = table.separator in (",", ";")
    fits = has_commas == (unit_ns == NS)
    columns = (EUROC if has_commas else TUM) if fits else usual
    if has_commas != (usual is EUROC) and len(table.rows[0]) >= 8:
        order = "qw, qx, qy, qz" if columns is EUROC else "qx, qy, qz, qw"
        remark(f"{table.path}: no header names its columns; quaternions are taken as {order}")
    return columns


def matrix_poses(table: Table, columns: int = 12) -> Array:
    """Return the poses (N, 4, 4) of rows of 12 or 16 numbers, a matrix by rows, after any time.

    Raises:
        DriftyardError: If a row has other columns or holds no rotation; of the table's class, names
            file and line.
    """
    expected = f"{columns} numbers with a pose matrix by rows (KITTI)"
    for i, row in enumerate(table.rows):
        if len(row) != columns:
            raise table.fault(i, f"{len(row)} columns; expected {expected}")
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3] = table.numbers(range(columns % 4, columns % 4 + 12), expected).reshape(-1, 3, 4)
    for i in np.flatnonzero(~_are_rotations(T[:, :3, :3])):
        raise table.fault(int(i), f"holds no rotation; expected {expected}")
    return T


def matrix_columns(table: Table) -> int | None:
    """Return the number of columns if the first row holds a pose matrix, after a time or alone."""
    row = table.rows[0]
    try:
        values = np.array([float(x) for x in row])
    except ValueError:
        return None
    if len(row) not in (12, 13, 16, 17) or not np.isfinite(values).all():
        return None
    T = values[len(row) % 4 :][:12].reshape(1, 3, 4)
    return len(row) if _are_rotations(T[:, :, :3])[0] else None


def _are_rotations(R: Array) -> Mask:
    errors = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0)
    return (errors < MAX_ROTATION_ERROR) & (np.linalg.det(R) > 0)


def _columns(header: tuple[str, ...], columns: int, leading: bool) -> PoseColumns | None:
    """Find the columns of a table of so many in the words of a header.

    Other words are leading, such as `format: timestamp tx ty tz qx qy qz qw`, or follow the names.
    """
    names: list[str] = []
    for word in header:
        name = re.sub(r"\s+", "", OF.sub("", word.lower()))
        groups = (x for pattern, x in GROUPS if pattern.fullmatch(name) and header.count(word) == 1)
        names += next(groups, (name,))
    time = next((i for i, name in enumerate(names) if TIME.fullmatch(name)), 0)
    if len(names) > columns and leading:
        names, time = names[time:], 0
    place: dict[str, int] = {}
    for i, name in enumerate(names[:columns]):
        for kind, pattern in (("p", POSITION), ("q", ROTATION)):
            if match := pattern.fullmatch(name):
                place.setdefault(kind + (match[1] or match[2]), i)
    if time in place.values() or not {"px", "py"} <= place.keys():
        return None
    quat = tuple(place[x] for x in ("qw", "qx", "qy", "qz") if x in place)
    position = tuple(place[x] for x in ("px", "py", "pz") if x in place)
    if len(position) == 2 and quat:
        return None
    return PoseColumns(time, position, quat if len(quat) == 4 else None)
