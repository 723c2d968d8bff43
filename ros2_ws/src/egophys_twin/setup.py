import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

package_name = "egophys_twin"

# Nodes run with the interpreter that `make setup` filled, whichever interpreter runs colcon.
venv_python = Path(__file__).resolve().parents[3] / ".venv/bin/python"
node_python = str(venv_python) if venv_python.exists() else sys.executable

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(include=[package_name, f"{package_name}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", glob("launch/*.launch.py")),
        (f"share/{package_name}/config", glob("config/*")),
        (f"share/{package_name}/rviz", glob("rviz/*")),
        (f"share/{package_name}/foxglove", glob("foxglove/*")),
    ],
    entry_points={
        "console_scripts": [
            "twin_node = egophys_twin.twin_node:main",
            "observer_node = egophys_twin.observer_node:main",
            "recorder_node = egophys_twin.recorder_node:main",
        ]
    },
    options={"build_scripts": {"executable": node_python}},
    zip_safe=False,
)
