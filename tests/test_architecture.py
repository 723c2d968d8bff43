"""The house: rooms depend downhill, light rooms stay light, modules are small and say what they are."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import egophys_core

PACKAGE = Path(egophys_core.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))

BASE = {
    "constants",
    "cores",
    "errors",
    "files",
    "geometry",
    "interpolation",
    "json_numbers",
    "minimum_jerk",
    "on_demand",
    "options",
    "episode",
    "plan_file",
    "waypoint_plan",
}
"""Plain modules that any room may use."""

MAY_USE: dict[str, set[str]] = {
    "lanes": set(),
    "recording": set(),
    "effects": {"lanes"},
    "robot": set(),
    "reporting": set(),
    "evaluation": set(),
    "rehearsal": set(),
    "perception": {"recording"},
    "twin": {"effects"},
    "simulation": {"lanes", "kinds", "twin", "effects"},
    "kinds": {"twin", "effects"},
    "prior": {"twin", "simulation"},
    "observation": {"kinds", "twin", "simulation", "evaluation"},
    "identification": {"effects", "kinds", "observation", "twin", "simulation", "evaluation", "prior"},
    "diagnosis": {
        "lanes",
        "effects",
        "kinds",
        "observation",
        "twin",
        "simulation",
        "evaluation",
        "identification",
        "reporting",
    },
    "experiments": {"diagnosis", "observation", "effects", "kinds", "twin", "simulation", "reporting", "robot"},
    "planning": {"recording", "twin", "simulation", "evaluation", "observation"},
    "episode_source": {"recording", "perception"},
    "replay": {"recording", "twin", "identification", "planning"},
    "cli": {
        "episode_source",
        "recording",
        "perception",
        "effects",
        "twin",
        "evaluation",
        "kinds",
        "observation",
        "identification",
        "diagnosis",
        "experiments",
        "planning",
        "rehearsal",
        "reporting",
        "replay",
        "robot",
    },
}
"""Which rooms a room may import from besides itself (DESIGN.md: data flow one way, never sideways)."""

HEAVY = ("torch", "rclpy")


def room_of(path: Path) -> str:
    """The room a file is in; a module beside the rooms is one of its own."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "package" if parts == ("__init__",) else parts[0]


def imported_rooms(path: Path) -> set[str]:
    """Rooms of this package that a file imports from anywhere in it, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "egophys_core" and len(parts) > 1 and parts[1] != "__version__":
                found.add(parts[1])
    return found


def modules_after_importing(name: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after importing one room."""
    program = f"import sys, {name}; print(' '.join({{each.split('.')[0] for each in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.split())


def test_house_page_lists_the_rooms_in_the_order_of_imports():
    page = (PACKAGE.parent / "docs/house.md").read_text()
    listed = [name for name in re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) if name in ROOMS]
    assert sorted(listed) == ROOMS
    for index, room in enumerate(listed):
        assert MAY_USE[room] & set(ROOMS) <= set(listed[:index]), room


def test_every_room_is_in_the_plan():
    assert set(ROOMS) <= set(MAY_USE)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_rooms_import_only_downhill(path):
    room = room_of(path)
    allowed = BASE | MAY_USE.get(room, set()) | {room}
    sideways = imported_rooms(path) - allowed
    assert not sideways, f"{room} imports {', '.join(sorted(sideways))}"


def test_plan_of_the_rooms_has_no_circle():
    done: set[str] = set()
    while len(done) < len(MAY_USE):
        ready = {room for room, uses in MAY_USE.items() if uses <= done} - done
        assert ready, f"circle among {set(MAY_USE) - done}"
        done |= ready


STEPS_OF_DIAGNOSIS = ("direct", "evidence", "hypotheses", "verdict")
"""Its sub-rooms in the order in which one builds on the other; what all use are modules beside them."""


@pytest.mark.parametrize("step", STEPS_OF_DIAGNOSIS)
def test_steps_of_a_diagnosis_build_only_on_earlier_ones(step):
    later = STEPS_OF_DIAGNOSIS[STEPS_OF_DIAGNOSIS.index(step) + 1 :]
    imports = re.compile(rf"egophys_core\.diagnosis\.({'|'.join(later) or 'diagnose'})\b")
    assert not [path.name for path in (PACKAGE / "diagnosis" / step).glob("*.py") if imports.search(path.read_text())]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_module_says_what_it_is_and_is_small(path):
    text = path.read_text()
    assert ast.get_docstring(ast.parse(text)), "no docstring"
    assert len(text.splitlines()) <= 500


@pytest.mark.parametrize("room", ROOMS)
def test_importing_a_room_loads_neither_torch_nor_ros(room):
    name = "egophys_core.cli.main" if room == "cli" else f"egophys_core.{room}"
    assert not modules_after_importing(name).intersection(HEAVY)


MAY_NAME_KINDS = {
    "perception/options.py": "what users choose of a video, by the same names; no twin is made of it there",
    "rehearsal/options.py": "the bodies of a world that knows nothing of twins",
    "cli/rehearse.py": "the same",
}
"""Modules outside of `kinds` that say a kind's name, and why."""


def names_of_kinds_in(path: Path) -> list[str]:
    """Where a module says the name of a kind, other than to say in which kinds an effect is common."""
    names = {module.stem for module in (PACKAGE / "kinds").glob("*.py") if "KIND = Kind(" in module.read_text()}
    tree = ast.parse(path.read_text())
    free = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.keyword) and node.arg == "common_in"
        for inner in ast.walk(node)
    }
    return [
        f"line {node.lineno}: {node.value!r}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and node.value in names and id(node) not in free
    ]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_module_outside_of_kinds_names_one(path):
    """All that differs by kind is asked of the kind: a new one is one file and one line."""
    where = path.relative_to(PACKAGE).as_posix()
    if path.parent.name != "kinds" and where not in MAY_NAME_KINDS:
        assert not names_of_kinds_in(path)


@pytest.mark.parametrize("room", ["recording", "twin", "robot", "evaluation", "waypoint_plan"])
def test_light_rooms_do_not_load_warp(room):
    assert "warp" not in modules_after_importing(f"egophys_core.{room}")


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_name_of_a_room_is_there(room):
    module = importlib.import_module(f"egophys_core.{room}")
    assert all(hasattr(module, name) for name in getattr(module, "__all__", ()))
    with pytest.raises(AttributeError, match="no_such_name"):
        module.no_such_name  # noqa: B018


@pytest.mark.parametrize("room", sorted(set(ROOMS) - {"cli", "diagnosis"}))
def test_every_room_lists_public_names_that_exist(room):
    module = importlib.import_module(f"egophys_core.{room}")
    assert module.__all__
    assert all(hasattr(module, name) for name in module.__all__)


def test_no_two_classes_share_a_name():
    roots = ("ros2_ws/src", "tests", "benchmarks", "examples", "tools")
    sources = [*MODULES, *(path for root in roots for path in (PACKAGE.parent / root).rglob("*.py"))]
    places: dict[str, list[str]] = {}
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(f"{path.relative_to(PACKAGE.parent)}:{node.lineno}")
    assert len(places) > 200
    assert {name: each for name, each in places.items() if len(each) > 1} == {}


def test_errors_of_this_project_have_one_base():
    from egophys_core import errors

    kinds = [each for each in vars(errors).values() if isinstance(each, type)]
    assert len(kinds) > 5
    assert all(issubclass(kind, errors.EgophysError) for kind in kinds)
