"""Where tests of the simulator roll out."""

import pytest

from egophys_core.simulation import rollout
from egophys_core.simulation.gradients import differentiate


@pytest.fixture(scope="module", autouse=True)
def _roll_out_on_the_device(request):
    """The device that pytest was asked for, where a test names none."""
    with pytest.MonkeyPatch.context() as patch:
        for function in (rollout, differentiate):
            patch.setitem(function.__kwdefaults__, "device", request.config.getoption("--device"))
        yield
