"""HTML pages from templates, each a single file without references to other files."""

import base64
import re
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from trials.report.figure import PALETTE
from vo.contract.files import write_text


def write_html(out: Path, template: str, **values: Any) -> None:
    """Render a template of this package with the common style sheet, and write the page."""
    environment = Environment(
        loader=PackageLoader("trials.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["code"] = _with_code
    write_text(out, environment.get_template(template).render(palette=PALETTE, **values))


def data_uri(content: bytes, kind: str) -> str:
    """Encode a file of a media type, such as `image/png`, as a data URI."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _with_code(text: str) -> Markup:
    """Escape text, and mark up as code what is between backticks."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))
