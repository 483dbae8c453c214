"""Clusters that a command starts: what is asked of them, and refusals in one line.

`make cloud` installs what these tests need.
"""

from pathlib import Path

import pytest
import yaml
from terminal import ROOT

from trials.execution import queues
from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.tasks import Task, WorkerError


def refused(scheduler: str) -> str:
    """Return the one line of a scheduler that cannot be started."""
    task = Task("nothing", "x", divmod, (1, 1))
    with using(Workers(1, scheduler)), pytest.raises(WorkerError) as caught:
        compute([task])
    (line,) = str(caught.value).splitlines()
    return line


def test_kubernetes_accepts_our_manifests():
    """Against the schemas of its API, nothing else allowed; quantities by their own words."""
    validate = pytest.importorskip("kubernetes_validate").validate
    pytest.importorskip("dask_kubernetes")
    text = (ROOT / "docs/examples/driftyard-kubernetes.yml").read_text()
    specs = [*yaml.safe_load_all(text)]
    parts = queues.kubernetes_spec("1.5Gi")["spec"]
    for part in ("scheduler", "worker"):
        pod = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": part}}
        specs.append({**pod, "spec": parts[part]["spec"]})
        (container,) = parts[part]["spec"]["containers"]
        assert container["command"][:2] == ["dask", part]
        assert "args" not in container
    assert len(specs) == 5
    for spec in specs:
        validate(spec, "1.29", strict=True)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "scheduler slurm: there is no sbatch on this machine"),
        ("echo invalid partition >&2; exit 1", "cannot be started ( .* invalid partition"),
    ],
)
def test_slurm_that_takes_no_job_is_one_line(tmp_path, monkeypatch, content, said):
    """There is no queue here: the second stands for one that refuses."""
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    if content:
        (tmp_path / "sbatch").write_text(f"#!/bin/sh\n{content}\n")
        (tmp_path / "sbatch").chmod(0o755)
    elif any((Path(x) / "sbatch").exists() for x in ("/bin", "/usr/bin")):
        pytest.skip("there is a queue")
    line = refused("slurm")
    assert all(x in line for x in said.split(" .* "))


@pytest.mark.parametrize(
    ("scheduler", "module"),
    [("kubernetes", "dask_kubernetes"), ("ssh:nowhere.invalid", "asyncssh")],
)
def test_unreachable_cluster_is_one_line(tmp_path, monkeypatch, scheduler, module):
    pytest.importorskip(module)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("KUBECONFIG", raising=False)
    assert f"scheduler {scheduler}: cannot be started (" in refused(scheduler)
