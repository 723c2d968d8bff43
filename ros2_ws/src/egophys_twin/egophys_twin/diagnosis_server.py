"""Diagnoses of the twin node: the action and the service DiagnoseTwin."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from egophys_msgs import action as actions
from egophys_msgs import srv as services
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import read_option_groups
from unique_identifier_msgs.msg import UUID

from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.twin import Twin, load_twin
from egophys_twin.asked_world import AskedWorld
from egophys_twin.build import NOT_KNOWN
from egophys_twin.diagnosis import Diagnosed, DiagnosisRequest, run_diagnosis
from egophys_twin.episode_parameters import SOURCE_GROUPS, episode_source, recorded_name
from egophys_twin.job_server import JobServer
from egophys_twin.jobs import Jobs, OnProgress

DIAGNOSIS_GROUP = (DiagnosisOptions, "diagnosis.")
"""The class of options and the prefix of its parameters."""

ERRORS = ("track_before_m", "track_after_m", "chamfer_before_m", "chamfer_after_m")


class DiagnosisServer(JobServer[DiagnosisRequest, Diagnosed]):
    """Diagnoses twins."""

    noun = "diagnosis"
    action = actions.DiagnoseTwin
    service = services.DiagnoseTwin

    def __init__(self, node: ManagedNode, jobs: Jobs, twin_in_use: Callable[[], Twin]) -> None:
        """Serve `~/diagnose` and `~/start_diagnosis`; `twin_in_use` raises TwinError if there is none."""
        super().__init__(node, jobs, action_name="~/diagnose", service_name="~/start_diagnosis")
        self._twin_in_use = twin_in_use
        self._arm = AskedWorld(node)

    def request_of(self, message: actions.DiagnoseTwin.Goal | services.DiagnoseTwin.Request) -> DiagnosisRequest:
        """The diagnosis that is asked for."""
        if message.ask:
            self._arm.require_bridge()
        options, *source = read_option_groups(self._node, (DIAGNOSIS_GROUP, *SOURCE_GROUPS), message.options_json)
        return DiagnosisRequest(
            twin=load_twin(Path(message.twin_path)) if message.twin_path else self._twin_in_use(),
            episode_paths=tuple(Path(path) for path in message.episode_paths),
            output_folder=Path(message.output_folder),
            options=options,
            without=tuple(message.without),
            seed=message.seed,
            source=episode_source(self._node, *source),
            namespace=self._node.get_namespace(),
            loads=tuple(message.loads_n),
            executed_topic=recorded_name(self._node, "executed_topic"),
            ask=message.ask,
        )

    def work(self, job_id: UUID, request: DiagnosisRequest, progress: OnProgress) -> Diagnosed:
        """Diagnose, with motions of the arm where they are wanted."""
        limits = self._arm.limits()
        return run_diagnosis(
            request,
            world=self._arm.of(request.twin, limits) if request.ask else None,
            limits=limits,
            progress=lambda stage, share: progress(stage, share, NOT_KNOWN),
        )

    def feedback(self, stage: str, share: float, loss: float) -> actions.DiagnoseTwin.Feedback:
        """Progress of a diagnosis."""
        return actions.DiagnoseTwin.Feedback(stage=stage, progress=share)

    def result_fields(self, made: Diagnosed) -> dict[str, Any]:
        """The diagnosis."""
        diagnosis = made.finding.diagnosis
        return {
            "outcome": str(diagnosis.outcome),
            "effects": [effect.name for effect in diagnosis.effects],
            "episodes": [error.episode for error in diagnosis.error],
            "asked": list(made.asked),
            "diagnosis_json": made.content,
            **{name: [getattr(error, name) for error in diagnosis.error] for name in ERRORS},
        }
