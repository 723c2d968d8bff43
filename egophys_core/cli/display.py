"""What the subcommands show: tables on standard output, a progress bar on standard error."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from egophys_core.json_numbers import nulled

if TYPE_CHECKING:
    from egophys_core.evaluation import Scores
    from egophys_core.perception.remarks import Remark


class Report(Protocol):
    """Updates the bar: a stage, the share done (0..1), and a note behind the bar."""

    def __call__(self, stage: str, share: float, note: str = "") -> None:
        """Show progress."""


class _Output(Console):
    """Standard output for tables of any text: names of files may hold what rich takes for markup.

    Where nobody reads it any more as for `print`: rich would exit with 1, which is a finding.
    """

    def __init__(self) -> None:
        super().__init__(markup=False, emoji=False)

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


@contextmanager
def progress_bar() -> Iterator[Report]:
    """A bar in a terminal, nothing elsewhere."""
    console = Console(stderr=True)
    texts = [TextColumn(each, markup=False) for each in ("{task.description:<10}", "{task.fields[note]}")]
    columns = (texts[0], BarColumn(), texts[1])
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=1.0, note="")

        def report(stage: str, share: float, note: str = "") -> None:
            progress.update(task, description=stage, completed=share, note=note)

        yield report


def print_json(content: Mapping[str, Any]) -> None:
    """One JSON object on standard output; numbers that are not finite become null."""
    print(json.dumps(nulled(content), indent=1))


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output; the first column is text, the others are numbers."""
    table = Table(title=title, title_justify="left")
    for index, name in enumerate(header):
        table.add_column(name, justify="right" if index else "left")
    for row in rows:
        table.add_row(*row)
    _Output().print(table)


def print_remarks(title: str, remarks: "Sequence[Remark]") -> None:
    """What was looked at, how good it is, and below what to do about the rest."""
    table = Table(title=title, title_justify="left")
    for name in ("", "", "measured"):
        table.add_column(name)
    colours = {"ok": "green", "doubtful": "yellow", "bad": "red"}
    for each in remarks:
        table.add_row(each.name, Text(each.level, style=colours[each.level]), each.text)
    _Output().print(table)
    for each in remarks:
        if each.advice:
            print(f"{each.name}: {each.advice}")


def print_scores(title: str, scores: "Mapping[str, Scores]") -> None:
    """Errors of several predictions in millimetres; train errors of a baseline that copies the data are blank."""
    header = ("prediction", "train CD", "test CD", "train TE", "test TE")
    rows = [
        (
            name,
            *(_millimetres(value) for value in (s.train_chamfer_m, s.test_chamfer_m, s.train_track_m, s.test_track_m)),
        )
        for name, s in scores.items()
    ]
    meaning = (
        "mm; CD Chamfer distance, TE track error;\ntrain: first 70 % of the frames, fitted; test: the held-out rest"
    )
    print_table(f"{title} ({meaning})", header, rows)


def _millimetres(value: float) -> str:
    return "-" if value != value else f"{1000 * value:.1f}"
