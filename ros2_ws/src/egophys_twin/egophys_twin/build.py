"""One build as the twin node runs it: check the request, read or perceive, fit, save. Imports no ROS."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from egophys_core.episode_source import PERCEPTION_SHARE, EpisodeSource, LoadedEpisode, is_video
from egophys_core.files import require_writable
from egophys_core.identification import FitOptions, Progress, beside_baselines, build
from egophys_core.observation import observe_episodes
from egophys_core.recording import list_topics
from egophys_core.twin import TWIN_FILE, Twin, save_twin
from egophys_twin.recorded_topics import source_in
from egophys_twin.recordings import loads_by_name, recorded_episodes, require_loads, require_recordings

NOT_KNOWN = float("nan")
"""Loss of a stage that has none."""


@dataclass(frozen=True, kw_only=True)
class BuildRequest:
    """What to build a twin from, how, and where to."""

    episode_paths: tuple[Path, ...]
    output_path: Path
    options: FitOptions
    seed: int
    source: EpisodeSource
    """How the recordings become episodes."""
    namespace: str = "/"
    """Of the names in it, see `recorded_topics`."""
    loads: tuple[float, ...] = ()
    """N that hang at the free end of an object seen at markers, one a recording; empty for none."""

    def check(self) -> None:
        """Look whether the build can start at all.

        Raises:
            RecordingError: no recording given, or one does not exist, is cut or damaged, or lacks a topic.
            OptionsError: not one load a recording, or one that is none.
            OutputError: the twin cannot be written where it is asked for.
        """
        require_recordings(self.episode_paths, self.source, namespace=self.namespace)
        require_loads(self.loads, self.episode_paths)
        require_writable(self.output_path, TWIN_FILE, inputs=self.episode_paths)


@dataclass(frozen=True, kw_only=True)
class BuiltTwin:
    """What a build ends with."""

    twin: Twin
    path: Path
    warning: str
    """That it loses to a prediction without physics; empty if it does not."""

    @property
    def summary(self) -> str:
        """For a person."""
        return f"built twin {self.twin.twin_id}: {self.path}" + (f"; {self.warning}" if self.warning else "")


def run_build(
    request: BuildRequest, *, on_episodes: Callable[[Sequence[LoadedEpisode]], None], progress: Progress
) -> BuiltTwin:
    """Read the recordings or perceive their videos, fit a twin and save it.

    Args:
        request: what to do; checked before.
        on_episodes: called with the episodes once they are read.
        progress: called with stage, share done and best loss (metres); raises to stop, and then no file is
            written.

    Raises:
        EgophysError: a recording, the fit or the file failed.
    """
    sources = [source_in(list_topics(path), request.source, request.namespace) for path in request.episode_paths]
    some_perceived = any(is_video(*each) for each in zip(request.episode_paths, sources, strict=True))
    perceiving = PERCEPTION_SHARE if some_perceived else 0.0
    loaded = recorded_episodes(
        request.episode_paths,
        sources,
        progress=lambda stage, share: progress(stage, perceiving * share, NOT_KNOWN),
    )
    on_episodes(loaded)
    episodes = [each.episode for each in loaded]
    observed = observe_episodes(episodes, loads_by_name(request.loads, episodes))
    twin = build(
        observed,
        request.options,
        seed=request.seed,
        progress=lambda stage, share, loss: progress(stage, perceiving + (1 - perceiving) * share, loss),
    )
    progress("save", 1.0, NOT_KNOWN)
    save_twin(twin, request.output_path)
    _, warning = beside_baselines(twin, observed[0])
    return BuiltTwin(twin=twin, path=request.output_path, warning=warning)
