#!/usr/bin/env bash
# Writes requirements/*.txt from requirements/*.in and pyproject.toml: exact versions, with the hashes of
# every platform's files. The sets agree with each other, because each is limited by those before it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

export UV_CUSTOM_COMPILE_COMMAND="make lock"
lock() {
    .venv/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url "$@"
}
lock requirements/build.in -o requirements/build.txt
lock pyproject.toml requirements/core.in -c requirements/build.txt -o requirements/core.txt
lock requirements/dev.in -c requirements/build.txt -c requirements/core.txt -o requirements/dev.txt
lock requirements/ros.in -c requirements/build.txt -c requirements/core.txt -c requirements/dev.txt \
    -o requirements/ros.txt
