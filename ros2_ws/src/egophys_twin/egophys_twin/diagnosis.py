"""One diagnosis as the twin node runs it: check the request, read the episodes, diagnose, save. Imports no ROS."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from egophys_core.diagnosis.diagnose import Finding, diagnose
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.saving import require_new_folder, save_finding
from egophys_core.episode_source import EpisodeSource
from egophys_core.twin import Twin
from egophys_twin.recordings import loads_by_name, observed_episodes, require_loads, require_recordings

READING_SHARE = 0.05
"""Part of the progress that reading takes."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisRequest:
    """Which twin to diagnose, from what, how, and where to write the answer."""

    twin: Twin
    episode_paths: tuple[Path, ...]
    output_folder: Path
    options: DiagnosisOptions
    without: tuple[str, ...]
    """Effects that are left out."""
    seed: int
    source: EpisodeSource
    """How recordings become episodes."""
    executed_topic: str
    """Topic that says of executed plans."""
    namespace: str = "/"
    """Of the names in these, see `recorded_topics`."""
    loads: tuple[float, ...] = ()
    """N that hang at the free end of an object seen at markers, one a recording; empty for none."""

    def check(self) -> None:
        """Look whether the diagnosis can start at all.

        Raises:
            RecordingError: no recording given, or one does not exist, is cut or damaged, or lacks a topic.
            OptionsError: not one load a recording, or one that is none.
            OutputError: the folder has something in it, or cannot be made.
        """
        require_recordings(
            self.episode_paths, self.source, namespace=self.namespace, executed_topic=self.executed_topic
        )
        require_loads(self.loads, self.episode_paths)
        require_new_folder(self.output_folder)


@dataclass(frozen=True, kw_only=True)
class Diagnosed:
    """What a diagnosis ends with."""

    finding: Finding
    path: Path
    """File of the improved twin."""
    content: str
    """Of `diagnosis.json`."""

    @property
    def twin(self) -> Twin:
        """The improved twin."""
        return self.finding.twin

    @property
    def summary(self) -> str:
        """For a person."""
        diagnosis = self.finding.diagnosis
        names = ", ".join(effect.name for effect in diagnosis.effects)
        return f"{diagnosis.outcome}{': ' + names if names else ''}. {diagnosis.reason} Twin {self.twin.twin_id}"


def run_diagnosis(request: DiagnosisRequest, *, progress: Callable[[str, float], None]) -> Diagnosed:
    """Read the recordings, diagnose the twin and save what was found.

    Args:
        request: what to do; checked before.
        progress: called with stage and share done; raises to stop, and then nothing is written.

    Raises:
        EgophysError: a recording, the diagnosis or the folder failed.
    """
    episodes = observed_episodes(
        request.episode_paths,
        request.source,
        executed_topic=request.executed_topic,
        namespace=request.namespace,
        grasp=request.twin.grasp,
        ground_height=request.twin.ground_height,
        progress=lambda stage, share: progress(stage, READING_SHARE * share),
    )
    finding = diagnose(
        request.twin,
        episodes,
        request.options,
        loads=loads_by_name(request.loads, episodes),
        without=request.without,
        seed=request.seed,
        progress=lambda stage, share: progress(stage, READING_SHARE + (1 - READING_SHARE) * share),
    )
    progress("save", 1.0)
    files = save_finding(finding, request.output_folder)
    return Diagnosed(finding=finding, path=files["twin"], content=files["diagnosis"].read_text())
