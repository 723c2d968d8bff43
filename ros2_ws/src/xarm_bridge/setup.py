import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

package_name = "xarm_bridge"

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
        (f"share/{package_name}/urdf", glob("urdf/*")),
    ],
    # What the emulator needs, which is of use without ROS: pip install this folder, run `emulator`.
    install_requires=["numpy", "scipy"],
    entry_points={
        "console_scripts": [
            "bridge_node = xarm_bridge.bridge_node:main",
            "emulator = xarm_bridge.emulator.server:main",
        ]
    },
    options={"build_scripts": {"executable": node_python}},
    zip_safe=False,
)
