"""Install a system of others: `python -m trials.estimators.systems.install orbslam3`."""

import sys

from trials.cli.main import guard
from trials.estimators.systems.environments import SYSTEMS, folder_of, install


def main() -> None:
    """Install the named systems, or list what there is."""
    for system in sys.argv[1:]:
        print(f"{system}: {install(system)}")
    if not sys.argv[1:]:
        for system, package in SYSTEMS.items():
            there = "installed" if folder_of(system).is_dir() else "not installed"
            print(f"{system} ({package.license}, {there}); needs {package.needs}")


if __name__ == "__main__":
    guard(main)
