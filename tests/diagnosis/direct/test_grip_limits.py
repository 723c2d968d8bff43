"""Detection limits of what grips tell: what is injected at twice the limit shows, at a third of it it does not."""

import pytest

from egophys_core.diagnosis.direct.grip_fit import explained, fit_grips, gains
from egophys_core.diagnosis.direct.grip_limits import limits_in_grips
from tests.diagnosis.direct.test_grips import three

NEEDED = 12.0


def limit(name, parameter, *, known=None, **changes):
    found = limits_in_grips(three(**changes), [name], known or {}, needed=NEEDED)
    return next(each for each in found if each.parameter == parameter).size


def gained(name, **injected):
    grips = three(**injected)
    return float(gains(grips, explained(grips, {}), fit_grips(grips, [name])).sum())


@pytest.mark.parametrize(
    ("name", "parameter", "injected"),
    [
        ("control_delay", "delay", lambda size: {"delay": size}),
        ("tracking_scale", "scale", lambda size: {"scale": 1.0 + size}),
    ],
)
def test_twice_the_limit_shows_and_a_third_of_it_does_not(name, parameter, injected):
    size = limit(name, parameter)
    assert size is not None
    assert gained(name, **injected(2.0 * size)) > NEEDED
    assert gained(name, **injected(size / 3.0)) < NEEDED


def test_noise_raises_the_limit():
    quiet, loud = (limit("control_delay", "delay", noise=noise) for noise in (5e-4, 4e-3))
    assert loud > 1.5 * quiet


def test_beside_what_is_known_a_limit_is_about_the_same():
    known = {"control_delay": {"delay": 0.1}}
    assert limit("tracking_scale", "scale", known=known, delay=0.1) == pytest.approx(
        limit("tracking_scale", "scale"), rel=0.5
    )
