"""`egophys info PATH`."""

import argparse
from pathlib import Path

from egophys_core.cli.display import print_json, print_table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("path", type=Path, metavar="PATH", help="twin file, .mcap file or rosbag2 folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def run(parsed: argparse.Namespace) -> int:
    """Print."""
    if _is_archive(parsed.path):
        _show_twin(parsed.path, parsed.json)
    else:
        _show_bag(parsed.path, parsed.json)
    return 0


def _is_archive(path: Path) -> bool:
    """Whether a file begins as a twin does, be it cut or not."""
    try:
        with path.open("rb") as stream:
            return stream.read(2) == b"PK"
    except OSError:
        return False  # a folder, or nothing; reading it as a bag says what


def _show_twin(path: Path, as_json: bool) -> None:
    from egophys_core.twin import load_twin

    twin = load_twin(path)
    graph = twin.model.graph
    content = {
        "twin_id": twin.twin_id,
        "nodes": len(graph.positions),
        "springs": len(graph.springs),
        "stiffness_model": twin.model.stiffness_model,
        **twin.header(),
    }
    if as_json:
        print_json(content)
        return
    provenance = content.pop("provenance")
    parameters = content.pop("parameters")
    for title, values in (
        ("twin", content),
        ("parameters (SI units)", parameters),
        ("provenance", provenance),
    ):
        print_table(title, ("name", "value"), [(name, f"{value}") for name, value in values.items()])


def _show_bag(path: Path, as_json: bool) -> None:
    from egophys_core.recording import list_topics

    topics = list_topics(path)
    if as_json:
        print_json(
            {
                "path": str(path),
                "topics": [{"name": t.name, "type": t.type, "messages": t.messages} for t in topics],
            }
        )
    else:
        print_table(str(path), ("topic", "type", "messages"), [(t.name, t.type, str(t.messages)) for t in topics])
