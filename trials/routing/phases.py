"""Phases of a signalized intersection, and the one that lets an urgent vehicle through.

Movements have the numbers of the NEMA: an odd one turns left, an even one drives straight on or
turns right. Every phase lets movements through that do not conflict.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from vo.contract.errors import SettingsError

Phase = tuple[int, ...]
"""Movements that have green at the same time, ascending."""

SIDES = ("north", "east", "south", "west")
"""Sides of an intersection, clockwise. A vehicle from the north drives south."""
LEFT: Mapping[str, int] = {"north": 7, "east": 1, "south": 3, "west": 5}
STRAIGHT: Mapping[str, int] = {"north": 4, "east": 6, "south": 8, "west": 2}
"""Movement from each side, straight on or to the right."""
APPROACH = {movement: side for by_side in (LEFT, STRAIGHT) for side, movement in by_side.items()}
"""Side from which each movement comes."""
EIGHT_PHASES: tuple[Phase, ...] = (
    (4, 7), (4, 8), (3, 8), (3, 7), (2, 5), (2, 6), (1, 6), (1, 5),
)  # fmt: skip
"""The usual phases, in an order in which one movement changes at most steps."""
MANEUVERS = tuple((a, b) for a in SIDES for b in SIDES if a != b)
"""Sides from which and to which a vehicle can drive."""


@dataclass(frozen=True)
class Choice:
    """Phase that an urgent vehicle needs, and whether it is the present one, extended."""

    phase: Phase
    is_extended: bool

    @property
    def text(self) -> str:
        """Cell of a table; an asterisk marks an extended phase."""
        return f"{phase_name(self.phase)}{'*' if self.is_extended else ''}"


def phase_name(phase: Phase) -> str:
    """Return the movements joined by +."""
    return "+".join(map(str, phase))


def movement_of(origin: str, target: str) -> int:
    """Return the movement from one side of an intersection to another."""
    turn = (SIDES.index(target) - SIDES.index(origin)) % 4
    return LEFT[origin] if turn == 1 else STRAIGHT[origin]


def are_compatible(a: int, b: int) -> bool:
    """Whether two movements may have green at the same time.

    They come from one side, or from opposite sides and both turn left or neither does.
    """
    turn = (SIDES.index(APPROACH[a]) - SIDES.index(APPROACH[b])) % 4
    return turn == 0 or (turn == 2 and a % 2 == b % 2)


def own_phase(origin: str) -> Phase:
    """Return the phase that lets all movements from one side through."""
    return tuple(sorted((LEFT[origin], STRAIGHT[origin])))


def select_phase(
    phases: Sequence[Phase], present: Phase, origin: str, target: str, is_congested: bool
) -> Choice:
    """Select the phase for an urgent vehicle by the rules of its congestion level.

    High congestion: all lights of its own approach turn green, whatever its target, so that the
    queue before it discharges. Low congestion: the present phase, if it lets the vehicle through;
    otherwise the phase that does and in which most movements of the other approaches flow, then
    the one in which most movements keep their green, then the first.

    Args:
        phases: Phases of the signal; those of `read_phases` let every vehicle through.
        present: The phase that is on.
        origin: Side from which the vehicle comes.
        target: Side to which it drives.
        is_congested: Whether a long queue is before it.

    Raises:
        SettingsError: If no phase lets the vehicle through.
    """
    if is_congested:
        own = own_phase(origin)
        return Choice(own, own == present)
    movement = movement_of(origin, target)
    if movement in present:
        return Choice(present, True)

    def flowing(phase: Phase) -> tuple[int, int]:
        return sum(APPROACH[x] != origin for x in phase), len({*phase} & {*present})

    passing = [phase for phase in phases if movement in phase]
    if not passing:
        raise SettingsError(f"phases: none lets movement {_named(movement)} through")
    return Choice(max(passing, key=flowing), False)


Table = Mapping[tuple[str, str], tuple[Choice, ...]]
"""By the sides from which and to which the vehicle drives, its choice during each phase."""


def selection_table(phases: Sequence[Phase], is_congested: bool) -> Table:
    """Apply `select_phase` to every maneuver during every phase."""
    return {
        (a, b): tuple(select_phase(phases, x, a, b, is_congested) for x in phases)
        for a, b in MANEUVERS
    }


def read_phases(text: str) -> tuple[Phase, ...]:
    """Parse phases such as "4+7,4+8".

    Raises:
        SettingsError: If a movement does not exist, movements of a phase conflict, a phase is given
            twice, or no phase lets some movement through.
    """
    phases: list[Phase] = []
    for word in text.split(","):
        parts = [x.strip() for x in word.split("+")]
        unknown = [x for x in parts if x not in map(str, APPROACH)]
        if unknown:
            raise SettingsError(f"phases: {word!r}: expected movements 1 to 8 joined by +, as 4+7")
        phase = tuple(sorted({int(x) for x in parts}))
        for a, b in combinations(phase, 2):
            if not are_compatible(a, b):
                raise SettingsError(f"phases: {word}: {_named(a)} and {_named(b)} conflict")
        if phase in phases:
            raise SettingsError(f"phases: {phase_name(phase)} is given twice")
        phases.append(phase)
    stopped = sorted({*APPROACH} - {x for phase in phases for x in phase})
    if stopped:
        names = ", ".join(map(_named, stopped))
        raise SettingsError(f"phases: {text}: no phase lets these movements through: {names}")
    return tuple(phases)


def _named(movement: int) -> str:
    turn = "left" if movement % 2 else "straight on"
    return f"{movement} ({turn} from the {APPROACH[movement]})"
