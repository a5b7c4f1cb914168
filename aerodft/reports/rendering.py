"""Pages from the templates beside this module: whatever a value says is shown as it is, in HTML as in Markdown."""

import base64
import re
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_MARKDOWN_SIGNS: Final = re.compile(r"([\\`*_{}\[\]<>#|~$&!()])")


def _as_markdown(value: object) -> Markup:
    """Escape a value for one line of Markdown; what is marked as Markdown stays."""
    if isinstance(value, Markup):
        return value
    line = "".join(each if each.isprintable() else " " for each in str(value))
    return Markup(_MARKDOWN_SIGNS.sub(r"\\\1", line))  # noqa: S704 - escaped here


_HTML: Final = Environment(
    loader=PackageLoader("aerodft.reports"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_MARKDOWN: Final = _HTML.overlay(finalize=_as_markdown)


def render_html(template: str, **values: object) -> str:
    """Render a page that needs no other file and no network.

    Args:
        template: Name of the template without ``.html.j2``.
        **values: What it shows. Texts are escaped, but for `Markup`.
    """
    return _HTML.get_template(f"{template}.html.j2").render(values)


def render_markdown(template: str, **values: object) -> str:
    """Render a page in Markdown.

    Args:
        template: Name of the template without ``.md.j2``.
        **values: What it shows. Texts are escaped, but for `Markup`, and their lines joined.
    """
    return _MARKDOWN.get_template(f"{template}.md.j2").render(values)


def image_source(data: bytes, kind: str) -> str:
    """Address that holds an image file's bytes, ``png`` or ``jpeg``."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
