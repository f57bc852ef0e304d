"""Order 1 of pictures against its closed form, however dense the voxels and however low the sun.

Deterministic: two Gauss points in parts of a step are off by .08 % at most here.
"""

import mcrt
import numpy as np
import pytest

SAME = pytest.mark.cpu_only("of the steps there are two kinds, and tau 1 and 30 take both")
WIDE = 1e4  # far wider than a mean free path: a half space


def seen(tau, mu0, mu, interpolation, albedo=0.7):
    """Order 1 of a half space lit at the cosine `mu0` and seen at `mu`, over its closed form.

    With a voxel that differs by 1e-4, so that the volume counts as heterogeneous.
    """
    layers = int(np.clip(12 / tau, 4, 150))
    density = np.ones((layers, 4, 4), np.float32)
    density[0, 0, 0] = 1.0001
    top, tilt = np.array((2 * WIDE, 2 * WIDE, layers)), np.sqrt(1 - mu**2)
    eye = top + 100 * np.array((0.6 * tilt, 0.8 * tilt, mu))
    camera = mcrt.OrthographicCamera(eye, top, up=(0, 1, 0), width=1e-3, resolution=(1, 1))
    result = mcrt.simulate(
        density,
        spacing=(1, WIDE, WIDE),
        interpolation=interpolation,
        extinction=tau,
        albedo=albedo,
        light=mcrt.DirectionalLight((np.sqrt(1 - mu0**2), 0, -mu0)),
        camera=camera,
        method="single",
        outputs=("image",),
        progress=False,
    )
    return result.image(order=1).item() * 4 * np.pi * (mu0 + mu) / (albedo * mu0)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("mu0", [1.0, 0.3, 0.05, 0.01])
@pytest.mark.parametrize(
    "tau", [*(pytest.param(tau, marks=SAME) for tau in (0.1, 0.2, 300.0)), 1.0, 30.0]
)
def test_order_1_of_a_half_space_is_its_closed_form(tau, mu0, interpolation):
    # Single precision places a point to 3e-7 voxels, and the depth towards the sun to as much
    # times tau / mu0; 4 nodes share the light.
    bound = 1.2e-3 + 2e-7 * tau / mu0
    for mu in (1.0, 0.2):
        assert seen(tau, mu0, mu, interpolation) == pytest.approx(1.0, abs=bound)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize(("mu0", "mu"), [(1.0, 1.0), (1.0, 0.4), (0.6, 1.0)])
def test_order_1_of_a_smooth_slab_from_the_light_grid_is_its_closed_form(mu0, mu, interpolation):
    """Whatever the profile: mu0 / (mu0 + mu) (1 - exp(-tau (1 / mu0 + 1 / mu))), tau the whole's.

    .1 %: interpolation errs by a twelfth of the depth's second differences, here .03 % at most.
    """
    layers, tau, albedo = 96, 2.0, 0.7
    z = (np.arange(layers) + 0.5) / layers
    profile = np.sin(np.pi * z) ** 2 * (1 + 0.5 * z)
    top, tilt = np.array((2 * WIDE, 2 * WIDE, layers)), np.sqrt(1 - mu**2)
    eye = top + 100 * np.array((0.6 * tilt, 0.8 * tilt, mu))
    result = mcrt.simulate(
        np.broadcast_to(profile[:, None, None], (layers, 4, 4)).astype(np.float32),
        spacing=(1, WIDE, WIDE),
        interpolation=interpolation,
        extinction=tau / profile.sum(),
        albedo=albedo,
        light=mcrt.DirectionalLight((np.sqrt(1 - mu0**2), 0, -mu0)),
        camera=mcrt.OrthographicCamera(eye, top, up=(0, 1, 0), width=1e-3, resolution=(1, 1)),
        method="single",
        outputs=("image",),
        progress=False,
    )
    assert "depth towards it from the light grid" in str(result.plan).replace("\n", " ")
    true = -albedo * mu0 / (4 * np.pi * (mu0 + mu)) * np.expm1(-tau * (1 / mu0 + 1 / mu))
    assert result.image(order=1).item() == pytest.approx(true, rel=5e-4)
