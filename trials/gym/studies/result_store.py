"""Results of trials on disk, world by world, so that an interrupted study continues."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from trials.gym.studies.trial_results import Result, TrialResult
from vo.contract.files import write_text


class ResultStore:
    """Results as JSON lines; until all are there, in a file beside `out` that ends in `.part`.

    Attributes:
        done: Results of this study by world.
    """

    def __init__(self, out: Path, study: str) -> None:
        """Continue what an interrupted run of the same study left.

        Args:
            out: File for the results.
            study: Everything that the results depend on, on one line; another one starts afresh.
        """
        self._out, self._study = out, study
        self._part = out.with_name(out.name + ".part")
        self.done: dict[int, list[TrialResult]] = {}
        lines = self._part.read_text(encoding="utf-8").splitlines() if self._part.is_file() else []
        if lines and lines[0] == study:
            for line in lines[1:]:
                result = TrialResult(**json.loads(line))
                self.done.setdefault(result.layout, []).append(result)
        out.parent.mkdir(parents=True, exist_ok=True)
        self._write_part()

    def add(self, of_world: Sequence[TrialResult]) -> None:
        """Store the results of a world."""
        self.done[of_world[0].layout] = list(of_world)
        self._write_part()

    def close(self) -> None:
        """Write all results, sorted by world."""
        write_text(self._out, json_lines(chain(*(self.done[k] for k in sorted(self.done)))))
        self._part.unlink()

    def _write_part(self) -> None:
        write_text(self._part, f"{self._study}\n{json_lines(chain(*self.done.values()))}")


def json_lines(results: Iterable[Result]) -> str:
    """Format results as JSON, one a line."""
    return "".join(json.dumps(asdict(result)) + "\n" for result in results)
