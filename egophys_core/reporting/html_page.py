"""Pieces of a page that stands alone: escaped text, tables, pictures in the file, no script, nothing from outside."""

import base64
from collections.abc import Sequence
from html import escape

STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 60rem; padding: 2rem 1.25rem 4rem; color: #1d2329; background: #fff;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.3; margin: .3rem 0 .6rem; font-weight: 650; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 2.4rem 0 .4rem; padding-top: .8rem; border-top: 1px solid #dde1e5; }
h3 { font-size: 1rem; margin: 1.2rem 0 .2rem; overflow-wrap: anywhere; }
p { margin: .4rem 0; max-width: 46rem; }
.quiet { color: #5b656f; font-size: .875rem; }
.tag { display: inline-block; padding: .1rem .6rem; border-radius: 1rem; color: #fff; font-size: .8rem; }
.cards { display: flex; flex-wrap: wrap; gap: .75rem; margin: 1.2rem 0; }
.card { flex: 1 1 10rem; padding: .7rem .9rem; border: 1px solid #dde1e5; border-radius: .5rem; }
.card b { display: block; font-size: 1.25rem; font-weight: 650; }
.next { margin: 1.2rem 0; padding: .8rem 1rem; border-left: 4px solid #e69f00; background: #fdf6e6; }
table { border-collapse: collapse; width: 100%; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th { font-weight: 600; font-size: .8rem; color: #5b656f; vertical-align: bottom; }
th, td { padding: .3rem .6rem; text-align: right; border-bottom: 1px solid #eceff1; overflow-wrap: anywhere; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td.wide, th.wide { width: 42%; min-width: 8rem; text-align: left; }
td.text, th.text { text-align: left; }
td.wide { padding-top: 0; padding-bottom: 0; }
.mark { display: block; width: 100%; height: 1.5rem; }
.pictures { display: flex; flex-wrap: wrap; gap: 0 1rem; }
figure { margin: .4rem 0; flex: 1 1 26rem; max-width: 46rem; }
figure img { display: block; width: 100%; height: auto; }
figcaption { font-size: .9rem; font-weight: 600; overflow-wrap: anywhere; }
code { font-family: ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace; font-size: .9em; }
summary { cursor: pointer; color: #0072b2; }
@media print { details > * { display: block; } h2 { break-after: avoid; } }
"""


class Markup(str):
    """Text that is HTML already; any other text is escaped."""

    __slots__ = ()


def html(content: object) -> Markup:
    """Markup as it is, everything else escaped."""
    return content if isinstance(content, Markup) else Markup(escape(str(content)))


def element(tag: str, *content: object, **attributes: str) -> Markup:
    """`<tag>content</tag>`; `class_` is the attribute class."""
    named = "".join(f' {name.rstrip("_")}="{escape(value)}"' for name, value in attributes.items())
    return Markup(f"<{tag}{named}>{''.join(html(each) for each in content)}</{tag}>")


def table(header: Sequence[object], rows: Sequence[Sequence[object]], *, kinds: Sequence[str]) -> Markup:
    """A table that scrolls by itself where the window is narrow.

    Args:
        header: of the columns.
        rows: cells, text or markup.
        kinds: per column "" for a number, "text", or "wide" for a mark.
    """

    def row(tag: str, cells: Sequence[object]) -> Markup:
        return element("tr", *(element(tag, cell, class_=kind) for cell, kind in zip(cells, kinds, strict=True)))

    return element("table", element("thead", row("th", header)), element("tbody", *(row("td", each) for each in rows)))


def picture(png: bytes, *, caption: object, says: str) -> Markup:
    """A PNG inside the page.

    Args:
        png: its content.
        caption: above it.
        says: what is to be seen, for those who cannot see it.
    """
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return element("figure", element("figcaption", caption), Markup(f'<img alt="{escape(says)}" src="{source}">'))


def page(title: str, *content: object) -> str:
    """The whole file."""
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style>"
    )
    body = "\n".join(html(each) for each in content)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'
