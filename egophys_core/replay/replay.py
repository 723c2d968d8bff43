"""All steps of a log done again, and whether its record can be trusted."""

from dataclasses import dataclass
from pathlib import Path

from egophys_core.replay.log import ReplayedLog
from egophys_core.replay.steps import (
    Comparison,
    Progress,
    ReplayOutcome,
    replay_build,
    replay_plan,
    replay_prediction,
)


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What came of replaying a log."""

    steps: tuple[Comparison, ...]
    """Build, plan and prediction."""
    lost: tuple[str, ...]
    """What the log lacks of what was published or written, a sentence each."""

    @property
    def is_good(self) -> bool:
        """Whether something was compared, all of it is the same, and nothing is lost."""
        outcomes = {each.outcome for each in self.steps} - {ReplayOutcome.NOT_RECORDED}
        return outcomes == {ReplayOutcome.SAME} and not self.lost


def replay_log(
    path: Path,
    *,
    twin_node: str | None = None,
    planner_node: str | None = None,
    progress: Progress = lambda step, share, best: None,
) -> Replay:
    """Do the build, the plan and the prediction of a log again from what it recorded of their inputs.

    A step whose inputs or outputs are not in the log is `NOT_RECORDED`; one of whose inputs a part is, `LOST`. On
    the CPU with the code version that made the log every other step is `SAME`.

    Args:
        path: the log, a rosbag2 folder or an MCAP file.
        twin_node: full name of the twin node, the prefix of its topics; None takes the one that the log has, in
            whatever namespace.
        planner_node: of the planner node.

    Raises:
        RecordingError: not a log, it has none of the nodes' topics, or those of nodes in several namespaces.
        EpisodeError: the training points in it form no episode.
    """
    log = ReplayedLog(path, twin_node=twin_node, planner_node=planner_node)
    steps = (replay_build(log, progress), replay_plan(log, progress), replay_prediction(log))
    return Replay(steps=steps, lost=tuple(log.lost))
