"""One build as the twin node runs it: check the request, read, fit, save. Imports no ROS."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from egophys_core.episode import Episode
from egophys_core.errors import RecordingError
from egophys_core.files import require_writable
from egophys_core.identification import FitOptions, Progress, build_twin
from egophys_core.recording import read_episode
from egophys_core.twin import Twin, save_twin

NOT_KNOWN = float("nan")


@dataclass(frozen=True, kw_only=True)
class BuildRequest:
    """What to build a twin from, how, and where to."""

    episode_paths: tuple[Path, ...]
    output_path: Path
    options: FitOptions
    seed: int
    object_topic: str
    """Topic of the object's points in the recordings."""
    controller_topic: str
    """Topic of the hands' points in the recordings."""

    def check(self) -> None:
        """Look whether the build can start at all.

        Raises:
            RecordingError: no recording given, or one does not exist.
            OutputError: the twin cannot be written where it is asked for.
        """
        if not self.episode_paths:
            raise RecordingError("no episode given; name at least one recording in episode_paths")
        for path in self.episode_paths:
            if not path.exists():
                raise RecordingError(f"{path}: no such recording on the machine of the twin node")
        require_writable(self.output_path)


def run_build(request: BuildRequest, *, on_episodes: Callable[[Sequence[Episode]], None], progress: Progress) -> Twin:
    """Read the recordings, fit a twin and save it.

    Args:
        request: what to do; checked before.
        on_episodes: called with the episodes once they are read.
        progress: called with stage, share done and best loss (metres); raises to stop, and then no file is
            written.

    Raises:
        EgophysError: a recording, the fit or the file failed.
    """
    episodes = []
    for path in request.episode_paths:
        progress(f"read {path.name}", 0.0, NOT_KNOWN)
        episodes.append(
            read_episode(path, object_topic=request.object_topic, controller_topic=request.controller_topic)
        )
    on_episodes(episodes)
    twin = build_twin(episodes, request.options, seed=request.seed, progress=progress)
    progress("save", 1.0, NOT_KNOWN)
    save_twin(twin, request.output_path)
    return twin
