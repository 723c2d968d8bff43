#!/usr/bin/env bash
# Usage: tools/build_workspace.sh STAMP
# Builds ros2_ws with colcon, in the environment of tools/ros_env.sh; colcon.meta has the options of each package.
# STAMP is written last.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
stamp=$PWD/$1
source tools/ros_env.sh
command -v colcon >/dev/null || { echo "error: no colcon; apt install python3-colcon-common-extensions" >&2; exit 1; }

echo "Building ros2_ws"
cd ros2_ws
rm -f "$stamp"
colcon --log-level error build --event-handlers console_cohesion- console_direct-
touch "$stamp"
