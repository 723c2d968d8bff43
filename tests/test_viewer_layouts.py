"""The layouts of RViz and Foxglove show topics that nodes publish, with a quality of service that matches."""

import json
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ros2_ws" / "src" / "egophys_twin"
LATCHED = ("Reliable", "Transient Local")
SHOWN = {
    "/ego/image_raw/compressed",
    "/observer_node/overlay/compressed",
    "/object/points",
    "/controller/points",
    "/twin_node/predicted/points",
    "/mppi_planner_node/target",
    "/mppi_planner_node/path",
    "/bridge_node/executed",
    "/robot_description",
}


def published() -> dict[str, str]:
    """Topics of the table in docs/nodes.md, `latched` or `topic`, by full name."""
    found, node = {}, ""
    for line in (ROOT / "docs" / "nodes.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and cells[1] in ("latched", "topic"):
            node = cells[0].strip("`") or node
            names = re.findall(r"`([~/\w]+)`", cells[2])
            # Names without a slash are relative: at the root where there is no namespace.
            found |= {f"/{name.replace('~', node).lstrip('/')}": cells[1] for name in names}
        elif len(cells) == 4:
            node = cells[0].strip("`") or node
    return found


@pytest.fixture(scope="module")
def displays() -> list[dict]:
    return rviz()["Displays"]


def rviz() -> dict:
    return yaml.safe_load((PACKAGE / "rviz" / "egophys.rviz").read_text())["Visualization Manager"]


def test_rviz_shows_all_of_it_in_the_world_with_matching_quality_of_service(displays):
    topics = [display.get("Topic") or display.get("Description Topic") for display in displays]
    asked = {f"/{each['Value']}": (each["Reliability Policy"], each["Durability Policy"]) for each in topics if each}
    assert set(asked) == SHOWN
    for name, kind in published().items():
        if name in asked:
            # A stream is best effort: a reliable subscription would get nothing of it, and say nothing.
            assert asked[name] == (LATCHED if kind == "latched" else ("Best Effort", "Volatile")), name
    assert set(asked) <= set(published())
    assert rviz()["Global Options"]["Fixed Frame"] == "world"
    (frames,) = (each for each in displays if each["Class"].endswith("/TF"))
    assert re.match(frames["Filter (whitelist)"], "tool")
    assert len({each["Name"] for each in displays}) == len(displays)


def test_foxglove_shows_the_same():
    layout = json.loads((PACKAGE / "foxglove" / "egophys.json").read_text())
    panels = layout["configById"]
    scene = panels["3D!scene"]
    shown = {name for name, settings in scene["topics"].items() if settings["visible"]}
    shown |= {panel["imageMode"]["imageTopic"] for name, panel in panels.items() if name.startswith("Image!")}
    shown |= {layer["topic"] for layer in scene["layers"].values() if "topic" in layer}
    assert shown <= set(published())
    assert shown >= SHOWN
    assert scene["followTf"] == "world"

    def names(part) -> list[str]:
        return [part] if isinstance(part, str) else names(part["first"]) + names(part["second"])

    assert sorted(names(layout["layout"])) == sorted(panels)


def test_layouts_are_installed():
    text = (PACKAGE / "setup.py").read_text()
    for folder, file in (("rviz", "egophys.rviz"), ("foxglove", "egophys.json")):
        assert f'(f"share/{{package_name}}/{folder}", glob("{folder}/*"))' in text
        assert (PACKAGE / folder / file).exists()
