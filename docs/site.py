"""Hooks of MkDocs: pages of the site that are not files in docs, and links to such files.

The changelog and the notes for contributors lie at the top of the repository, notebooks are
converted with the outputs that are stored in them, and the page of the command line is made from
its options. MkDocs calls the functions by their names.
"""

import json
import re
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from mkdocs.structure.files import File, Files

from trials.cli.registry import COMMANDS, PANELS, load

ROOT = Path(__file__).parents[1]
TOP_PAGES = {"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md"}
ALONE = ("index.md", "tasks.md")
"""Pages that are the only ones of their tab."""
PNG = b"\x89PNG"
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made here."""

    def add(uri: str, content: str | bytes) -> None:
        files.append(File.generated(config, uri, content=content))

    for uri, source in TOP_PAGES.items():
        add(uri, (ROOT / source).read_text("utf-8"))
    add("commands.md", "\n".join(command_lines()))
    for notebook in [x for x in files if x.src_uri.endswith(".ipynb")]:
        uri = Path(notebook.src_uri)
        cells = json.loads(Path(notebook.abs_src_path or "").read_text("utf-8"))["cells"]
        parts: list[str] = []
        for k, cell in enumerate(cells):
            for part in cell_parts(cell):
                if isinstance(part, bytes):
                    name = f"{uri.stem}_{k}.{'png' if part.startswith(PNG) else 'jpg'}"
                    add(str(uri.with_name(name)), part)
                    part = f"![Output of the cell above]({name})"
                parts.append(part)
        parts.insert(1, f"[Notebook]({uri.name}){{ .md-button download }}")
        add(str(uri.with_suffix(".md")), "\n\n".join(parts))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links lead to pages of the site; text remains of a link to a file of the code."""
    if page.file.src_uri in ALONE:
        page.meta["hide"] = ["navigation"]
    folder = Path(page.file.src_uri).parent

    def follow(link: re.Match[str]) -> str:
        text, target = link.groups()
        if "://" in target or target.startswith("#"):
            return link[0]
        path, hash_sign, anchor = target.partition("#")
        if page.file.src_uri in TOP_PAGES:
            path = path.removeprefix("docs/")
        if path.endswith(".ipynb") and folder / path != Path(page.file.src_uri).with_suffix(
            ".ipynb"
        ):
            path = path.removesuffix(".ipynb") + ".md"
        names = {source: uri for uri, source in TOP_PAGES.items()}
        path = names.get(path, names.get(path.removeprefix("../"), path))
        beside = (ROOT / "docs" / folder / path).resolve()
        if not beside.is_relative_to(ROOT / "docs"):
            return text
        return f"[{text}]({path}{hash_sign}{anchor})"

    return LINK.sub(follow, markdown)


def cell_parts(cell: dict[str, Any]) -> Iterator[str | bytes]:
    """Give a notebook's cell as Markdown, pictures among its outputs as bytes."""
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield f"```python\n{source}\n```"
    for output in cell["outputs"]:
        data = output.get("data", {"text/plain": output.get("text", "")})
        if pictures := [x for kind, x in data.items() if kind.startswith("image/")]:
            yield b64decode("".join(pictures[0]))
        elif "text/html" in data:
            html = re.sub(r"\n\s*", " ", "".join(data["text/html"]))
            yield f'<div class="output">{html}</div>'
        else:
            yield f"```{{ .text .output }}\n{''.join(data['text/plain']).rstrip()}\n```"


def command_lines() -> Iterator[str]:
    """Give the page of the command line: every command with its options."""
    yield "# Command line"
    yield "`driftyard COMMAND --help` prints the same. Options that may be repeated end in ….\n"
    for panel, commands in PANELS.items():
        yield f"\n## {panel}"
        for name in commands:
            command = load(name)
            yield f"\n### driftyard {name}\n\n{command.help or COMMANDS[name].summary}"
            yield f"\n```sh\n{COMMANDS[name].example}\n```\n"
            context = typer.Context(command, info_name=f"driftyard {name}")
            if rows := [row for x in command.get_params(context) if (row := option_row(x))]:
                yield from ("| option | default | |", "|---|---|---|", *rows)


def option_row(parameter: Any) -> str | None:
    """Give the row of an option or an argument in the table of its command."""
    if parameter.name == "help":
        return None
    names = ", ".join(f"`{x}`{{.nowrap}}" for x in [*parameter.opts, *parameter.secondary_opts])
    if parameter.param_type_name == "argument":
        names = f"`{parameter.name.upper()}`"
    default = parameter.default
    shown = (
        "" if default in (None, False, True, (), [], "") or callable(default) else f"`{default}`"
    )
    text = " ".join((getattr(parameter, "help", None) or "").split()).replace("|", "\\|")
    return f"| {names}{'…' if parameter.multiple else ''} | {shown} | {text} |"
