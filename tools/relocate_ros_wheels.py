"""Point the CMake files of the ROS wheels at this environment's Python and numpy, not the build machine's."""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

BUILD_MACHINE = "/opt/python/cp"
SITE_PACKAGES = r"/opt/python/cp\d+-cp\d+/lib/python3\.\d+/site-packages"
REPLACEMENTS = (
    (r"/opt/python/cp\d+-cp\d+/include/python3\.\d+", sysconfig.get_path("include")),
    # The wheels were built with numpy 2, whose headers moved; what they contain runs with numpy 1 too.
    (SITE_PACKAGES + r"/numpy/_?core/include", np.get_include()),
    (SITE_PACKAGES, sysconfig.get_path("purelib")),
)


def relocated(text: str) -> str:
    """Return `text` with the build machine's folders replaced by this interpreter's."""
    for pattern, here in REPLACEMENTS:
        text = re.sub(pattern, here, text)
    return text


def main() -> int:
    """Rewrite the CMake files under share/ in place; a second run changes nothing."""
    for path in sorted(Path(sys.prefix, "share").rglob("*.cmake")):
        text = path.read_text(encoding="utf-8")
        if BUILD_MACHINE not in text:
            continue
        text = relocated(text)
        if BUILD_MACHINE in text:
            line = next(line for line in text.splitlines() if BUILD_MACHINE in line)
            print(f"error: {path}: unknown path of the build machine: {line.strip()}", file=sys.stderr)
            return 1
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
