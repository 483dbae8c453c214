"""Clusters that a command starts for its tasks: by SLURM, in Kubernetes, on hosts by SSH."""

import importlib
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any
from uuid import uuid4

from trials.execution.tasks import WorkerError
from vo.contract.errors import DriftyardError, SettingsError

TRIES = 3
"""Attempts at a task whose worker was lost each time, by workers that this command started."""
SINGLE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS",
     "LP_NUM_THREADS"), "1",
)  # fmt: skip
"""Environment of a local worker: processes on all cores with several threads each are slower."""
OURS: dict[str, Any] = {
    "distributed.nanny.pre-spawn-environ": SINGLE_THREAD,
    "distributed.scheduler.allowed-failures": TRIES - 1,
    # No task waits at a worker, where the loss of the worker would count against it.
    "distributed.scheduler.worker-saturation": 1.0,
    # On a busy machine a lost worker takes long to start again; given up, all would wait.
    "distributed.deploy.lost-worker-timeout": "1 hour",
}
"""Configuration of Dask for schedulers and workers that this command starts."""


@contextmanager
def started_cluster(name: str, count: int, memory_gb: float) -> Generator[Any]:
    """Start a scheduler and workers with a thread and so much memory each; yield its cluster.

    Raises:
        WorkerError: If it cannot be started, for whatever reason.
        SettingsError: If there is no such kind of scheduler.
    """
    import dask.config

    with dask.config.set(OURS):
        try:
            cluster = _started(name, count, memory_gb)
        except DriftyardError:
            raise
        except Exception as error:  # whatever its library, its queue or its hosts make of it
            reason = " ".join(str(error).split()) or type(error).__name__
            raise WorkerError(f"scheduler {name}: cannot be started ({reason})") from None
        with cluster:
            yield cluster


def _started(name: str, count: int, memory_gb: float) -> Any:
    kind, _, hosts = name.partition(":")
    if kind == "slurm":
        (made,) = _imported("dask_jobqueue", "SLURMCluster")
        if shutil.which(made.job_cls.submit_command) is None:
            raise WorkerError(
                f"scheduler slurm: there is no {made.job_cls.submit_command} on this machine; run "
                "the command where jobs are submitted"
            )
        import dask.config

        first = dask.config.get("jobqueue.slurm.job-script-prologue", None) or []
        lines = [f"export {x}={y}" for x, y in SINGLE_THREAD.items()]
        size = {"cores": 1, "processes": 1, "job_cpu": 1, "memory": f"{memory_gb:g}GiB"}
        cluster = made(**size, job_script_prologue=[*first, *lines])
        cluster.sync(_submit_first, cluster)
    elif kind == "kubernetes":
        cluster = _in_kubernetes(f"{memory_gb:g}Gi")
    elif kind == "ssh" and hosts:
        _imported("asyncssh")
        from distributed import SSHCluster

        names = hosts.split(",")
        options = {"nthreads": 1, "n_workers": count}
        return SSHCluster([names[0], *names], worker_options=options)
    else:
        raise SettingsError(
            f"--scheduler {name}: expected tcp://HOST:PORT, slurm, kubernetes or ssh:HOST,HOST"
        )
    cluster.scale(count)
    return cluster


def _in_kubernetes(memory: str) -> Any:
    (made,) = _imported("dask_kubernetes.operator", "KubeCluster")
    (api,) = _imported("kr8s", "api")
    api().version()  # raises before there is a cluster, which would be ended in vain
    return made(custom_cluster_spec=kubernetes_spec(memory), n_workers=0, quiet=True)


def kubernetes_spec(memory: str) -> dict[str, Any]:
    """Return a DaskCluster of Dask's operator, with no workers yet; memory as `1.5Gi`.

    Its containers have commands: an image, as ours, may have another entry point than a shell.
    """
    (spec_of,) = _imported("dask_kubernetes.operator", "make_cluster_spec")
    import dask.config

    spec = spec_of(
        f"driftyard-{uuid4().hex[:8]}",  # another command may have one
        image=dask.config.get("kubernetes.image"),
        n_workers=0,
        resources={"requests": {"cpu": "1", "memory": memory}, "limits": {"memory": memory}},
        env={**(dask.config.get("kubernetes.env") or {}), **SINGLE_THREAD},
        worker_command=["dask", "worker", "--nthreads", "1"],
    )
    for part in ("scheduler", "worker"):
        (container,) = spec["spec"][part]["spec"]["containers"]
        container["command"] = container.pop("args")
        if part == "scheduler":
            container["command"] = ["dask", "scheduler", "--host", "0.0.0.0"]
    return spec


async def _submit_first(cluster: Any) -> None:
    """Submit a job, and wait until the queue has taken it: `scale` would log a refusal alone."""
    from distributed.core import Status

    cluster.scale(1)
    try:
        await cluster._correct_state()
    finally:
        for job in cluster.workers.values():
            if job.status is Status.created:  # refused: there is nothing to end
                job.status = Status.failed


def _imported(module: str, *names: str) -> list[Any]:
    try:
        found = importlib.import_module(module)
    except ImportError:
        raise WorkerError(f"{module} is not installed: pip install 'driftyard[cluster]'") from None
    return [getattr(found, name) for name in names]
