"""Builds of the twin node: BuildTwin and RebuildTwin."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from egophys_msgs.action import BuildTwin
from egophys_msgs.srv import RebuildTwin
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import read_option_groups
from unique_identifier_msgs.msg import UUID

from egophys_core.episode_source import LoadedEpisode
from egophys_core.identification import FitOptions
from egophys_twin.build import BuildRequest, BuiltTwin, run_build
from egophys_twin.episode_parameters import SOURCE_GROUPS, episode_source
from egophys_twin.job_server import JobServer
from egophys_twin.jobs import Jobs, OnProgress
from egophys_twin.twin_topics import TwinTopics


class BuildServer(JobServer[BuildRequest, BuiltTwin]):
    """Builds twins, and publishes what they are built from."""

    noun = "build"
    action = BuildTwin
    service = RebuildTwin

    def __init__(self, node: ManagedNode, jobs: Jobs, topics: TwinTopics) -> None:
        """Serve `~/build` and `~/rebuild`."""
        super().__init__(node, jobs, action_name="~/build", service_name="~/rebuild")
        self._topics = topics

    def request_of(self, message: BuildTwin.Goal | RebuildTwin.Request) -> BuildRequest:
        """The build that is asked for."""
        fit, *source = read_option_groups(self._node, ((FitOptions, ""), *SOURCE_GROUPS), message.options_json)
        return BuildRequest(
            episode_paths=tuple(Path(path) for path in message.episode_paths),
            output_path=Path(message.output_path),
            options=fit,
            seed=message.seed,
            source=episode_source(self._node, *source),
            namespace=self._node.get_namespace(),
            loads=tuple(message.loads_n),
        )

    def work(self, job_id: UUID, request: BuildRequest, progress: OnProgress) -> BuiltTwin:
        """Build, telling of the episodes once they are read."""
        tell = partial(self._node.hand_over, self._tell_of_episodes, job_id, request)
        return run_build(request, on_episodes=tell, progress=progress)

    def feedback(self, stage: str, share: float, loss: float) -> BuildTwin.Feedback:
        """Progress of a build."""
        return BuildTwin.Feedback(stage=stage, progress=share, best_loss=loss)

    def result_fields(self, made: BuiltTwin) -> dict[str, Any]:
        """Nothing but the twin."""
        return {}

    def _tell_of_episodes(self, job_id: UUID, request: BuildRequest, loaded: Sequence[LoadedEpisode]) -> None:
        self._topics.publish_training(job_id, request, loaded)
        for each in loaded:
            for note in each.report.notes if each.report else ():
                self._node.get_logger().info(f"{each.episode.name}: {note}")
