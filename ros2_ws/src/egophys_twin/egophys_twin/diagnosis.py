"""One diagnosis as the twin node runs it: check the request, read the episodes, diagnose, save. Imports no ROS."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from egophys_core.diagnosis.diagnose import Finding
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.saving import save_finding
from egophys_core.episode import Episode
from egophys_core.episode_source import EpisodeSource
from egophys_core.experiments import HandLimits, Proposal, diagnose_and_ask
from egophys_core.files import require_new_folder
from egophys_core.recording import write_episode
from egophys_core.twin import Twin
from egophys_twin.recordings import loads_by_name, observed_episodes, require_loads, require_recordings

READING_SHARE = 0.05
"""Part of the progress that reading takes."""

Tell = Callable[[str], None]
"""Called with what is being done, over and over; raises to stop."""

DoMotion = Callable[[Proposal, int, Tell], Episode]
"""Does a motion with the object, the how manieth, and records it."""


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
    ask: int = 0
    """Motions that the arm is asked for at most."""

    @property
    def asked_folder(self) -> Path:
        """Of what is recorded of these."""
        folder = Path(os.path.abspath(self.output_folder))
        return folder.with_name(f"{folder.name}_asked")

    def check(self) -> None:
        """Look whether the diagnosis can start at all.

        Raises:
            RecordingError: no recording given, or one does not exist, is cut or damaged, or lacks a topic.
            OptionsError: not one load a recording, or one that is none.
            OutputError: a folder has something in it, or cannot be made.
        """
        require_recordings(
            self.episode_paths, self.source, namespace=self.namespace, executed_topic=self.executed_topic
        )
        require_loads(self.loads, self.episode_paths)
        require_new_folder(self.output_folder)
        if self.ask:
            require_new_folder(self.asked_folder)


@dataclass(frozen=True, kw_only=True)
class Diagnosed:
    """What a diagnosis ends with."""

    finding: Finding
    path: Path
    """File of the improved twin."""
    content: str
    """Of `diagnosis.json`."""
    asked: tuple[str, ...] = ()
    """What was asked for and done, in words."""

    @property
    def twin(self) -> Twin:
        """The improved twin."""
        return self.finding.twin

    @property
    def summary(self) -> str:
        """For a person."""
        diagnosis = self.finding.diagnosis
        names = ", ".join(effect.name for effect in diagnosis.effects)
        asked = f" (motions asked for: {len(self.asked)})" if self.asked else ""
        found = f"{diagnosis.outcome}{': ' + names if names else ''}{asked}"
        return f"{found}. {diagnosis.reason} Twin {self.twin.twin_id}"


def run_diagnosis(
    request: DiagnosisRequest,
    *,
    world: DoMotion | None,
    limits: HandLimits,
    progress: Callable[[str, float], None],
) -> Diagnosed:
    """Read the recordings, diagnose the twin, ask for motions where that is wanted, and save what was found.

    Args:
        request: what to do; checked before.
        world: does motions; what is recorded of each is saved at once; None where none is asked for.
        limits: what hands can do in it.
        progress: called with stage and share done; raises to stop, and then nothing but such recordings is written.

    Raises:
        EgophysError: a recording, the diagnosis, a motion or a folder failed.
    """
    done = READING_SHARE

    def report(stage: str, share: float) -> None:
        nonlocal done
        done = READING_SHARE + (1 - READING_SHARE) * share
        progress(stage, done)

    def recorded(world: DoMotion, proposal: Proposal, number: int) -> Episode:
        episode = world(proposal, number, lambda stage: progress(stage, done))
        request.asked_folder.mkdir(exist_ok=True)
        write_episode(episode, request.asked_folder / f"motion_{number}")
        return episode

    episodes = observed_episodes(
        request.episode_paths,
        request.source,
        executed_topic=request.executed_topic,
        namespace=request.namespace,
        grasp=request.twin.grasp,
        ground_height=request.twin.ground_height,
        progress=lambda stage, share: progress(stage, READING_SHARE * share),
    )
    answer = diagnose_and_ask(
        request.twin,
        episodes,
        request.options,
        None if world is None else partial(recorded, world),
        most=request.ask,
        limits=limits,
        loads=loads_by_name(request.loads, episodes),
        without=request.without,
        seed=request.seed,
        progress=report,
    )
    progress("save", 1.0)
    files = save_finding(answer.finding, request.output_folder)
    return Diagnosed(
        finding=answer.finding,
        path=files["twin"],
        content=files["diagnosis"].read_text(),
        asked=tuple(each.proposal.motion.sentence for each in answer.asked),
    )
