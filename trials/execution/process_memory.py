"""How much memory a process holds."""

import os
from pathlib import Path


def resident_mb() -> float:
    """Memory of this process that is in RAM now, in MB of 2^20 bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
