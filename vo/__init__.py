"""The stereo visual odometry estimator, and nothing else."""

import hashlib
from pathlib import Path


def _forget_stale_machine_code() -> None:
    """Delete numba's cache where a compiled source has changed.

    Numba looks for changes in a function's own file only; what it calls in another file would
    stay as it was.
    """
    folder = Path(__file__).parent
    sources = (file.read_bytes() for file in sorted(folder.rglob("*.py")))
    digest = hashlib.sha256(b"".join(x for x in sources if b"@numba" in x)).hexdigest()
    stamp = folder / "__pycache__" / "compiled.sha256"
    try:
        if stamp.is_file() and stamp.read_text() == digest:
            return
        for pattern in ("*.nbi", "*.nbc"):
            for file in folder.rglob(pattern):
                file.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest)
    except OSError:
        return  # nobody changes the sources of a folder that cannot be written


_forget_stale_machine_code()
