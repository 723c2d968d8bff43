"""What all tests need before any of them is collected."""

from pathlib import Path

# The arm's SDK makes this folder when it is imported, and fails where two processes do so at once.
(Path.home() / ".UFACTORY/log/xarm/sdk").mkdir(parents=True, exist_ok=True)
