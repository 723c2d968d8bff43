"""The errors this project raises on purpose: each says what was wrong, where, and what to do."""


class EgophysError(Exception):
    """Base of every error a user can cause or mend; the command line prints it and exits with 2."""


class OptionsError(EgophysError):
    """An option is unknown, of the wrong type or out of its range."""


class EpisodeError(EgophysError):
    """Observed data do not form an episode: wrong shape, not finite, nothing visible, no controllers."""


class RecordingError(EgophysError):
    """A bag or log cannot be read or written: not found, cut, missing topic, wrong type."""


class TwinError(EgophysError):
    """A twin cannot be built, loaded or saved, or does not fit what it is used with."""


class SimulationError(EgophysError):
    """A rollout cannot start (shapes, topology) or diverged; names node and time."""


class PlanningError(EgophysError):
    """A planning problem is ill-posed: no target points, no grasp, horizon of zero length."""


class RobotError(EgophysError):
    """A motion is refused before anything moves, or the arm reported a fault."""


class ArmLostError(RobotError):
    """The arm's controller does not answer, or the connection to it is gone."""


class ArmFaultError(RobotError):
    """The arm's controller is in an error state that someone has to look at and clear."""


class OutputError(EgophysError):
    """A result cannot be written where it was asked for."""


class DiscrepancyError(EgophysError):
    """The discrepancy between a twin and its episodes cannot be looked into."""
