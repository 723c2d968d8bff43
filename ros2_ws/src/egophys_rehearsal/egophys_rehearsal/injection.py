"""What the parameters ask to be injected. Imports no ROS."""

import json

from egophys_core.errors import OptionsError
from egophys_core.rehearsal import complete_effects, injected_sizes

NONE = "none"
SIZES = ("small", "large")


def injected_effects(names: str, *, size: str, parameters_json: str) -> dict[str, dict[str, float]]:
    """Effects with all their parameters.

    Args:
        names: of effects, separated by spaces or commas; `none` or empty for none.
        size: `small` or `large`, of those whose parameters are not given.
        parameters_json: a JSON object of parameters by effect, `{"control_delay": {"delay": 0.1}}`; these win over
            the size. Empty: none.

    Raises:
        OptionsError: an effect, parameter or size is unknown, or it is not such a JSON object.
    """
    if size not in SIZES:
        raise OptionsError(f"effect_size must be one of {', '.join(SIZES)}, got {size!r}")
    try:
        given = json.loads(parameters_json or "{}")
    except json.JSONDecodeError as error:
        raise OptionsError(f"effect_parameters is not JSON: {error}") from error
    if not isinstance(given, dict) or not all(isinstance(each, dict) for each in given.values()):
        raise OptionsError(f"effect_parameters must be a JSON object of objects, got {parameters_json}")
    injected = {name: injected_sizes(name)[size] for name in names.replace(",", " ").split() if name != NONE}
    for name, values in given.items():
        if name not in injected:
            raise OptionsError(f"effect_parameters has {name!r}, which is not in effects; there is {names or NONE}")
        injected[name] |= values
    return complete_effects(injected)
