"""The ledger: trials on disk, world by world, so that an interrupted study goes on."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from trials.gym.studies.trial_protocol import Trial
from vo.contract.files import write_text


class Ledger:
    """JSON lines of trials; until all are there, beside `out` in a file that ends in `.part`.

    Attributes:
        done: Trials by world, of this study.
    """

    def __init__(self, out: Path, study: str) -> None:
        """Take up what an interrupted run of the same study left.

        Args:
            out: File for the trials.
            study: Everything that the trials depend on; another one begins anew.
        """
        self._out, self._study = out, study
        self._part = out.with_name(out.name + ".part")
        self.done: dict[int, list[Trial]] = {}
        if self._part.is_file():
            self._take_up(self._part.read_text(encoding="utf-8").splitlines())
        out.parent.mkdir(parents=True, exist_ok=True)
        self._save()

    def add(self, of_world: Sequence[Trial]) -> None:
        """Keep the trials of a world."""
        self.done[of_world[0].layout] = list(of_world)
        self._save()

    def close(self) -> None:
        """Write the whole, sorted by world."""
        lines = [_line(trial) for layout in sorted(self.done) for trial in self.done[layout]]
        write_text(self._out, "".join(lines))
        self._part.unlink()

    def _take_up(self, lines: Sequence[str]) -> None:
        if lines and lines[0] == self._study:
            for line in lines[1:]:
                trial = Trial(**json.loads(line))
                self.done.setdefault(trial.layout, []).append(trial)

    def _save(self) -> None:
        trials = [_line(trial) for of_world in self.done.values() for trial in of_world]
        write_text(self._part, self._study + "\n" + "".join(trials))


def _line(trial: Trial) -> str:
    return json.dumps(asdict(trial)) + "\n"
