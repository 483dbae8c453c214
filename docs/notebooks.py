"""Run notebooks and store their outputs: python docs/notebooks.py [NAME.ipynb ...].

Without names, all of docs/notebooks. Pictures are stored small, and
what is written to stderr is not stored.
"""

import io
import re
import sys
import tempfile
from base64 import b64decode, b64encode
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent / "notebooks"
WIDTH_PX = 720
"""Largest width and height of a picture."""
RESET = "\x1b[0m"
"""What IPython writes before the output of a command."""
DATA_URI = re.compile(r"data:image/png;base64,([\w+/=]+)")


def main(paths: list[Path]) -> None:
    """Run each notebook in an empty folder of its own."""
    for path in paths or sorted(FOLDER.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        with tempfile.TemporaryDirectory() as folder:
            place = {"metadata": {"path": folder}}
            NotebookClient(
                notebook, record_timing=False, coalesce_streams=True, resources=place
            ).execute()
        for cell in notebook.cells:
            if cell.cell_type == "code":
                cell.outputs = [stored(x) for x in cell.outputs if x.get("name") != "stderr"]
        notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
        nbformat.write(notebook, path)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")


def stored(output: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Return an output with its picture, if it has one, in the shorter of two formats."""
    data = output.get("data", {})
    if "image/png" in data:
        picture = Image.open(io.BytesIO(b64decode(data["image/png"]))).convert("RGB")
        picture.thumbnail((WIDTH_PX, WIDTH_PX))
        files = {"image/png": io.BytesIO(), "image/jpeg": io.BytesIO()}
        picture.quantize(64).save(files["image/png"], "png", optimize=True)
        picture.save(files["image/jpeg"], "jpeg", quality=85)
        kind = min(files, key=lambda x: len(files[x].getvalue()))
        output["data"] = {kind: b64encode(files[kind].getvalue()).decode("ascii")}
    elif "text" in output:
        output["text"] = output["text"].replace(RESET, "").lstrip()
    elif "text/html" in data:
        data["text/html"] = DATA_URI.sub(_shorter_uri, data["text/html"])
    return output


def _shorter_uri(uri: re.Match[str]) -> str:
    stream = io.BytesIO()
    Image.open(io.BytesIO(b64decode(uri[1]))).convert("L").save(stream, "jpeg", quality=85)
    return f"data:image/jpeg;base64,{b64encode(stream.getvalue()).decode('ascii')}"


if __name__ == "__main__":
    main([Path(x) for x in sys.argv[1:]])
