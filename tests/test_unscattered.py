"""Unscattered light in voxels, thin and thick, against quadrature and closed forms.

Standard errors come from few lattices of rays: z follows Student's t with 7 degrees of freedom.
False alarms: 1e-5 per assertion.
"""

import comparing
import mcrt
import numpy as np
import pytest
import truth

DOF = 7
VIEW = truth.View((40, -30, 25), (2, 2, 2), (4, 4), fov=30)


def run(density, **options):
    options = {"method": "single", "max_scatterings": 1, "outputs": ("fluence",)} | options
    return mcrt.simulate(np.asarray(density, np.float32), camera=VIEW.camera(), **options)


def mottled():
    return np.random.default_rng(3).random((20, 20, 20)) < 1 / 3


def absorbed_over_balance(result, spacing=(1, 1, 1)):
    """The sum of the voxels' absorbed power over that of the energy balance, and its error."""
    volume, balance = np.prod(spacing), result.energy.absorbed * result.energy.launched
    total = result.absorbed.sum(dtype=float) * volume
    error = np.sqrt(np.square(result.absorbed_error, dtype=float).sum()) * volume
    return total / balance, error / balance


@pytest.mark.parametrize("depth", [2, 8, 30])
def test_voxels_of_thick_media_absorb_what_the_balance_says(depth):
    result = run(
        mottled(),
        extinction=depth,
        albedo=0.6,
        interpolation="nearest",
        light=mcrt.DirectionalLight((-0.4, 0.1, -1)),
        method="photon",
        max_scatterings=None,
        photons=2e5,
        seed=1,
    )
    ratio, error = absorbed_over_balance(result)
    noise = comparing.fraction_error(result.energy.absorbed, 2e5) / result.energy.absorbed
    assert abs(ratio - 1) < 0.002 + 3 * np.hypot(error, noise)


@pytest.mark.cpu_only("found on the host whatever the backend")
def test_voxels_of_a_thick_ramp_absorb_what_the_balance_says():
    ramp = np.broadcast_to(np.linspace(0, 1, 12)[:, None, None], (12, 12, 12))
    result = run(ramp, extinction=15, albedo=0.6, light=mcrt.PointLight((6, 5, 30), 100), seed=2)
    ratio, error = absorbed_over_balance(result)
    assert abs(ratio - 1) < 0.002 + 3 * error


@pytest.mark.cpu_only("found on the host whatever the backend")
def test_layers_of_a_slab_under_a_low_sun_follow_beer_lambert():
    # Light comes from larger x. Where x is small it has come in by the upper face.
    for mu0, layers, lit in ((0.3, 4, 40), (0.02, 1, 5)):
        sun = mcrt.DirectionalLight((-np.sqrt(1 - mu0**2), 0, -mu0), 2.0)
        slab = np.ones((4, 6, 60))
        fluence = run(slab, extinction=1, albedo=0, interpolation="nearest", light=sun).fluence
        mean = fluence[::-1, :, :lit].mean((1, 2), dtype=float)[:layers]
        true = 2 * mu0 * -np.diff(np.exp(-np.arange(layers + 1) / mu0))
        np.testing.assert_allclose(mean, true, rtol=0.002 if mu0 == 0.3 else 0.01)


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("depth", [0.3, 5.0])
@pytest.mark.parametrize("kind", ["sun", "low sun", "outside", "on a face"])
def test_voxels_are_their_quadrature(kind, depth, interpolation):
    rng = np.random.default_rng(5)
    shape, spacing = (4, 5, 6), (1.0, 0.3, 2.0)
    density = np.where(rng.random(shape) < 0.3, 0, rng.random(shape)).astype(np.float32)
    size = np.multiply(shape, spacing)[::-1]
    light = {
        "sun": truth.Directional((-0.4, 0.5, -0.8), 2.0),
        "low sun": truth.Directional((-1, 0.3, -0.02), 2.0),
        "outside": truth.Point((14, -7, 16), 300.0),
        "on a face": truth.Point((0.0, 0.7 * size[1], 0.4 * size[2]), 300.0),
    }[kind]
    if isinstance(light, truth.Point):
        api = mcrt.PointLight(light.position, light.intensity)
    else:
        api = mcrt.DirectionalLight(light.direction, light.irradiance)
    result = run(
        density,
        spacing=spacing,
        extinction=depth,
        interpolation=interpolation,
        light=api,
        albedo=0.5,
        seed=3,
    )
    sigma = depth * density.astype(float)
    linear = interpolation == "linear"
    coarse, fine = (
        truth.fluence_of_order_0(light, sigma, spacing, linear, order=order) for order in (6, 9)
    )
    # The quadrature's own error, at edges of shadows within a voxel: both orders share some of it.
    doubt = 3 * np.abs(fine - coarse) + 5e-3 * fine
    scale = np.hypot(result.fluence_error, doubt)
    z = (result.fluence - fine) / np.where(scale > 0, scale, 1)
    bright = fine > 1e-12 * fine.max()
    assert np.abs(z[bright]).max() < comparing.limit(bright.sum(), DOF)
    assert np.sqrt(np.mean(z[bright] ** 2)) < 1.5


@pytest.mark.cpu_only("found on the host whatever the backend")
def test_error_bars_of_unscattered_light_are_calibrated():
    options = {"extinction": 30, "albedo": 0.6, "interpolation": "nearest"}
    light = mcrt.DirectionalLight((-0.4, 0.1, -1))
    runs = [run(mottled(), light=light, seed=seed, **options) for seed in range(20)]
    values = np.array([r.fluence for r in runs], float)
    errors = np.array([r.fluence_error for r in runs], float)
    lit = values.mean(0) > 1e-3 * values.max()
    spread, claimed = values.var(0, ddof=1)[lit].sum(), (errors**2).mean(0)[lit].sum()
    assert claimed > 0
    assert spread / claimed == pytest.approx(1, abs=0.15)


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("depth", [0.01, 1, 30])
def test_a_change_of_one_voxel_by_little_changes_little(depth):
    density = np.ones((6, 7, 8))
    other = density.copy()
    other[2, 3, 4] += 1e-5
    options = {
        "extinction": depth,
        "albedo": 0.7,
        "light": mcrt.PointLight((3.2, -4, 9), 10.0),
        "outputs": ("fluence", "radiance"),
    }
    a, b = (run(d, **options) for d in (density, other))
    for name in ("fluence", "absorbed", "radiance"):
        one, two = getattr(a, name).astype(float), getattr(b, name).astype(float)
        assert np.abs(two - one).max() < 2e-5 * max(1, depth) * one.max()


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("extinction", [0.5, 5.0])
def test_one_voxel_in_a_void_absorbs_what_the_balance_says(extinction):
    density = np.zeros((5, 5, 5))
    density[2, 2, 2] = 1
    light = mcrt.DirectionalLight((0, 0, -1))
    result = run(density, extinction=extinction, albedo=0, light=light)
    # Columns of the trilinear hat: its integral along z is the hat in x and y.
    hat = np.concatenate([np.linspace(0, 1, 401)[:-1], np.linspace(1, 0, 401)])
    true = (1 - np.exp(-extinction * np.outer(hat, hat))).sum() / 400**2
    total, balance = result.absorbed.sum(dtype=float), result.energy.absorbed * 25
    assert total == pytest.approx(true, rel=0.002)
    assert balance == pytest.approx(true, rel=0.002)


UNRESOLVED = pytest.mark.cpu_only("photons of a GPU start where single precision puts the light")
PLACES = {
    "face": ((0.0, 1.3, 2.2), 1 / 2),
    "edge": ((0.0, 6.0, 2.2), 3 / 4),
    "corner": ((5.0, 6.0, 4.0), 7 / 8),
    "inside": ((2.0, 3.0, 1.0), 0),  # where voxels meet
}


@pytest.mark.parametrize("how", ["absorbing", "single", "photon"])
@pytest.mark.parametrize(
    "hair", [0.0, pytest.param(1e-9, marks=UNRESOLVED), pytest.param(-1e-9, marks=UNRESOLVED)]
)
@pytest.mark.parametrize("place", PLACES)
def test_a_point_light_on_the_box_sends_its_share_past_it(place, hair, how):
    position, missed = PLACES[place]
    # A hair towards the middle, or away from it.
    middle = np.array([2.5, 3.0, 2.0])
    position = np.array(position) + hair * np.sign(middle - position)
    options = {"method": "photon", "photons": 2e4} if how == "photon" else {}
    energy = run(
        np.random.default_rng(9).random((4, 6, 5)),
        extinction=2.0,
        albedo=0.0 if how == "absorbing" else 0.6,
        light=mcrt.PointLight(position, 3.0),
        seed=4,
        **options,
    ).energy
    comparing.assert_balance(energy)
    if hair <= 0:
        noise = comparing.fraction_error(missed, 2e4)
        comparing.assert_z(energy.missed, missed, np.hypot(noise, 1e-6))
