"""Options of studies: the processes and machines that run their tasks."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from trials.cli.options import option


@dataclass(frozen=True)
class WorkersOptions:
    """Processes and machines that run the tasks of a command."""

    PANEL: ClassVar[str] = "Workers"
    workers: int | None = option(
        None,
        "Number of processes, or of workers to ask a queue for; 0 for none but this process.",
        min=0,
        show_default="as many as cores and memory allow",
    )
    scheduler: str = option(
        "",
        "Cluster instead of this machine: a Dask scheduler's tcp://HOST:PORT, slurm, kubernetes, "
        "or ssh:HOST,HOST.",
        metavar="ADDRESS",
    )
    workers_per_gpu: int | None = option(
        None,
        "Most local processes for each GPU, if there are any; `bench --only devices` measures it.",
        min=1,
        show_default="no limit",
    )
    store: str = option(
        "",
        "Location where machines without a common folder share results: s3://BUCKET/NAME, "
        "gs://..., sftp://..., or a folder.",
        metavar="URL",
    )
    log: Path | None = option(
        None, "File that gets a line of JSON for each task.", "--task-log", metavar="FILE"
    )

    def using(self) -> AbstractContextManager[None]:
        """Let the tasks of a block run there."""
        from trials.cli import console
        from trials.execution.cluster import Workers
        from trials.execution.executor import using

        def announce(link: str) -> None:
            if console.err.is_terminal:
                console.err.print(f"dashboard: {link}", markup=False)

        return using(
            Workers(
                self.workers,
                self.scheduler,
                store=self.store,
                log=self.log,
                per_gpu=self.workers_per_gpu,
                announce=announce,
            )
        )
