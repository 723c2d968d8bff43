"""Pages from the templates of this room: escaped text, tables, pictures in the file, nothing from outside."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of a page; cells are escaped unless they are `Markup`."""

    header: Sequence[object]
    """Of the columns."""
    rows: Sequence[Sequence[object]]
    kinds: Sequence[str]
    """Per column "" for a number, "text", or "wide" for a mark."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG inside a page."""

    png: bytes
    caption: object
    says: str
    """What is to be seen, for those who cannot see it."""

    @property
    def source(self) -> str:
        """As an address that holds its content."""
        return f"data:image/png;base64,{base64.b64encode(self.png).decode()}"


def bold(text: object) -> Markup:
    """The text, escaped, in bold."""
    return Markup("<b>{}</b>").format(text)


def coloured(text: object, colour: str) -> Markup:
    """The text, escaped, in a colour of CSS."""
    return Markup('<span style="color: {}">{}</span>').format(colour, text)


def render(template: str, **data: object) -> str:
    """The page of a template of this room; what it asks for and `data` lacks is an error."""
    return _environment().get_template(template).render(**data)


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("egophys_core.reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
