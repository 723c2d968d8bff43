"""Where a plan comes from: whether it was made for the twin in use, and lately."""

from dataclasses import dataclass

from egophys_core.errors import RobotError
from egophys_core.waypoint_plan import NANOSECONDS, WaypointPlan

CLOCKS_APART_S = 1.0
"""A plan from a machine whose clock is ahead by less is taken."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What plans are held against."""

    twin_id: str
    """Twin in use, empty if not known."""
    max_age: float
    """Seconds; 0 for any age."""
    max_age_name: str = "max_plan_age_s"
    """Of the option or parameter that sets it, for messages."""


def check_origin(plan: WaypointPlan, stamp_ns: int, now_ns: int, origin: Origin) -> None:
    """Refuse a plan that was made with another twin or too long ago.

    Args:
        plan: what is to be executed.
        stamp_ns: when it was planned, nanoseconds since the epoch; 0 where nobody said.
        now_ns: now.
        origin: what is asked of plans.

    Raises:
        RobotError: names both twins, or the age.
    """
    if origin.twin_id and plan.twin_id and plan.twin_id != origin.twin_id:
        raise RobotError(f"the plan was made with twin {plan.twin_id}, in use is {origin.twin_id}; plan again")
    if not origin.max_age:
        return
    if not stamp_ns:
        raise RobotError(
            f"the plan does not say when it was made (its stamp is 0); stamp it, or set {origin.max_age_name} to 0 to "
            "take plans of any age"
        )
    age = (now_ns - stamp_ns) / NANOSECONDS
    if not -CLOCKS_APART_S <= age <= origin.max_age:
        when = f"{age:.0f} s ago" if age >= 0 else f"{-age:.0f} s in the future"
        raise RobotError(
            f"the plan was made {when}, at most {origin.max_age:g} s may pass ({origin.max_age_name}): the object may "
            "lie elsewhere by now; plan again"
        )
