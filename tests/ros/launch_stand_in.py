"""Classes that remember what a launch file makes of them, where `launch` itself cannot be installed."""

import importlib
import runpy
import sys
from types import ModuleType

PARTS = "egophys_ros_common.launch_parts"


class StoodIn:
    """What was called with what."""

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named

    @property
    def name(self):
        return self.named.get("name") or self.positional[0]


class LaunchDescription(StoodIn):
    @property
    def entities(self):
        return self.positional[0]


class PythonLaunchDescriptionSource(StoodIn):
    def get_launch_description(self, context):
        return runpy.run_path(self.name)["generate_launch_description"]()


CLASSES = {
    "launch": ["LaunchContext", LaunchDescription, "LaunchDescriptionEntity"],
    "launch.actions": ["DeclareLaunchArgument", "IncludeLaunchDescription", "LogInfo", "OpaqueFunction", "Shutdown"],
    "launch.conditions": ["IfCondition"],
    "launch.events": [],
    "launch.events.process": ["ProcessExited"],
    "launch.launch_description_sources": [PythonLaunchDescriptionSource],
    "launch.substitutions": ["LaunchConfiguration", "NotEqualsSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
}


def install(monkeypatch):
    """Put them in place of `launch` and `launch_ros`; the module that the launch files share, made with them."""
    for name, classes in CLASSES.items():
        module = ModuleType(name)
        for each in classes:
            made = type(each, (StoodIn,), {}) if isinstance(each, str) else each
            setattr(module, made.__name__, made)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, PARTS, raising=False)
    parts = importlib.import_module(PARTS)
    monkeypatch.delitem(sys.modules, PARTS)
    monkeypatch.setitem(sys.modules, PARTS, parts)
    return parts
