# Puts this project into a bash shell: `source tools/ros_env.sh`.
# Where /opt/ros/jazzy is sourced that ROS is used, else the one that `make setup` installed into .venv.
_repo="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"

export PATH="$_repo/.venv/bin:${PATH#"$_repo/.venv/bin:"}"
if [[ -z "${ROS_DISTRO:-}" ]]; then
    export AMENT_PREFIX_PATH="$_repo/.venv" CMAKE_PREFIX_PATH="$_repo/.venv"
fi
if [[ -f "$_repo/ros2_ws/install/local_setup.bash" ]]; then
    source "$_repo/ros2_ws/install/local_setup.bash"
fi
unset _repo
