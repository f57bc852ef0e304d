"""The comparison with Mitsuba rejects what is wrong: seen here, each mistake alone, per method.

The right scene passes the same test in the same case.
"""

import mcrt
import mitsuba_cases as suite
import mitsuba_reference
import numpy as np
import pytest
from mitsuba_stored import stored
from test_mitsuba_pairs import LEVEL

pytestmark = pytest.mark.cpu_only("how sharp the comparison is does not depend on the backend")

METHODS = suite.AXES["method"]
THICK = "woodcock, linear, hg .3, outside, 5, grey, 0.9, 3, perspective"
THIN = "woodcock, linear, isotropic, directional, 5, grey, 0.9, 0.1, perspective"
MORE = {THICK: 1, THIN: 8}  # times the usual samples of Mitsuba


def shifted(axis):
    def wrong(given):
        step = np.zeros(3)
        step[axis] = given["spacing"][2 - axis] / 2
        return {"origin": tuple(given["origin"] + step)}

    return wrong


def flipped(axis):
    return lambda given: {"volume": np.flip(given["volume"], 2 - axis)}


WRONG = {
    "g + 0.1": (THICK, lambda given: {"phase": mcrt.HenyeyGreenstein(0.4)}),
    "g - 0.1": (THICK, lambda given: {"phase": mcrt.HenyeyGreenstein(0.2)}),
    "extinction + 1 %": (THIN, lambda given: {"extinction": 1.01 * given["extinction"]}),
    "extinction - 1 %": (THIN, lambda given: {"extinction": 0.99 * given["extinction"]}),
    **{f"{'xyz'[axis]} flipped": (THICK, flipped(axis)) for axis in range(3)},
    **{f"half a voxel along {'xyz'[axis]}": (THICK, shifted(axis)) for axis in range(3)},
}


def case_of(method, values):
    case = dict(zip(suite.AXES, (method, *values.split(", ")), strict=True))
    return case | {"orders": "1"} if method == "single" else case


def jobs():
    """What Mitsuba renders for this file."""
    return [
        mitsuba_reference.job(case_of(method, values), more)
        for method in METHODS
        for values, more in MORE.items()
    ]


def probability(method, values, wrong):
    case = case_of(method, values)
    true = stored(mitsuba_reference.job(case, MORE[values]))
    return suite.compare(case, suite.ours(case, wrong=wrong)[0], true).p.min()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_rejected(wrong, method):
    values, change = WRONG[wrong]
    assert probability(method, values, change) < LEVEL


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("values", [THICK, THIN])
def test_what_is_right_is_not(values, method):
    assert probability(method, values, lambda given: {}) > LEVEL
