"""What effects do to residuals, from all of their starts or from some."""

import numpy as np

from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.ranking import probe_effects, surroundings
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import LIBRARY
from tests.diagnosis.rehearsed import episodes, sheet


def test_of_many_starts_some_are_probed_evenly_and_do_what_they_do_among_all():
    observations = [observe(sheet(), episodes()[0])]
    found = [each[0] for each in residuals(observations, [sheet()])]

    def probed(most):
        others = LIBRARY.keys() - {"hidden_tether"}
        return probe_effects(
            observations, sheet(), found, without=others, most_starts=most, progress=lambda share: None
        )

    one, some, every = probed(1), probed(3), probed(None)
    starts = LIBRARY["hidden_tether"].starts(surroundings(sheet(), observations))
    assert [each.start for each in one] == [starts[len(starts) // 2]]
    assert [each.start for each in some] == [starts[0], starts[len(starts) // 2], starts[-1]]
    among_all = {tuple(each.start.values()): each.slopes[0] for each in every}
    for each in some:
        np.testing.assert_allclose(each.slopes[0], among_all[tuple(each.start.values())], atol=1e-6)
