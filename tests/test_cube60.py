"""MCX's benchmark cube60. False alarms: 1e-5 per assertion, 3 assertions."""

import comparing
import mcrt
import numpy as np
import pytest

PHOTONS = 3e5


@pytest.mark.parametrize("tracker", ["woodcock", "analytic"])
def test_cube60_absorbs_as_mcx(tracker):
    mu_a, mu_s = 0.005, 1.0  # [1/mm]
    result = mcrt.simulate(
        np.ones((60, 60, 60), np.float32),
        spacing=1.0,
        extinction=mu_a + mu_s,
        albedo=mu_s / (mu_a + mu_s),
        phase=mcrt.HenyeyGreenstein(0.01),
        light=mcrt.PencilBeam((30, 30, -1), (0, 0, 1), 1.0),
        photons=PHOTONS,
        tracker=tracker,
        outputs=["fluence"],
        errors=False,
        method="photon",
        seed=31,
    )
    # 0.1769 as published, four digits; one photon's absorbed weight has a standard deviation below
    # 0.25.
    comparing.assert_z(result.energy.absorbed, 0.1769, np.hypot(0.25 / np.sqrt(PHOTONS), 5e-5))
    # The absorbed power density integrates to the absorbed fraction but for rounding: deposits in
    # 216,000 voxels are integers.
    assert np.asarray(result.absorbed, float).sum() == pytest.approx(
        result.energy.absorbed, rel=1e-5
    )
    assert result.energy.escaped["-z"] > 0.5 > 10 * result.energy.escaped["+z"]
    sides = [result.energy.escaped[face] for face in ("-x", "+x", "-y", "+y")]
    comparing.assert_z(sides, np.mean(sides), comparing.fraction_error(np.mean(sides), PHOTONS))
