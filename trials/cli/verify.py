"""`driftyard verify`: whether a dataset is as it was recorded."""

from pathlib import Path

import typer

from sim.certificate.certificate import detectable_shifts
from sim.certificate.label_coverage import coverage_statement
from sim.certificate.verify import verify as find_faults
from trials.cli import console
from trials.cli.options import argument
from vo.contract.dataset import read_manifest


def verify(
    dataset: Path = argument(..., "Dataset folder that `generate` wrote."),
) -> None:
    """Recompute every hash and the certificate of a dataset; state which shift it would find.

    The exit status is 1 if a file is missing, differs, or the certificate does not hold.
    """
    with console.progress_bar("verifying") as progress:
        findings = find_faults(dataset, progress)
    for finding in findings:
        console.out.print(f"{dataset / finding.file}: {finding.problem}")
    if findings:
        raise typer.Exit(1)
    console.out.print(f"{dataset}: every hash, the manifest and the certificate hold")
    certificate = read_manifest(dataset)["certificate"]
    for line in [*detectable_shifts(certificate), coverage_statement(certificate)]:
        console.out.print(line, markup=False)
