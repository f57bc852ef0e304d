"""Slabs and half spaces against adding-doubling and H-function values.

Slabs are boxes one voxel wide and 1e4 or more lengths across. False alarms: 1e-5 per assertion,
about 60 assertions. Fractions of the launched power carry the bound sqrt(p (1 - p) / N) as their
standard error: the bounds are generous by what stratified first collisions save.
"""

import closed_forms
import comparing
import mcrt
import numpy as np
import pytest

WIDE = 1e4
TRACKERS = ["woodcock", "march", "analytic"]


def slab(tau, layers, axis=0, wide=WIDE):
    """Shape and spacing of a slab whose normal is the array axis."""
    shape, spacing = [1, 1, 1], [wide] * 3
    shape[axis], spacing[axis] = layers, tau / layers
    return np.ones(shape, np.float32), tuple(spacing)


def shoot(tau, layers=8, axis=0, mu0=1.0, **options):
    """Fractions of a pencil beam reflected and transmitted (with the unscattered), and all else."""
    density, spacing = slab(tau, layers, axis)
    normal = 2 - axis  # of the world axes x, y, z
    position, direction = np.full(3, WIDE / 2), np.zeros(3)
    position[normal], direction[normal] = -1.0, mu0
    direction[(normal + 1) % 3] = np.sqrt(1 - mu0**2)
    result = mcrt.simulate(
        density,
        spacing=spacing,
        interpolation="nearest",
        light=mcrt.PencilBeam(tuple(position), tuple(direction), 1.0),
        outputs=["fluence"],
        errors=False,
        method="photon",
        **options,
    )
    face, energy = "xyz"[normal], result.energy
    return energy.escaped["-" + face], energy.escaped["+" + face] + energy.unscattered, result


@pytest.mark.parametrize("tracker", TRACKERS)
@pytest.mark.parametrize(
    ("albedo", "tau", "g", "reflected", "transmitted", "photons", "digits"),
    [
        (0.9, 2, 0.75, 0.09739, 0.66096, 4e5, 5e-6),  # van de Hulst 1980, table 35
        (0.9, 2, 0.0, 0.361649, 0.356501, 4e5, 5e-7),
        (1.0, 1, 0.0, 0.341329, 0.658671, 4e5, 5e-7),
        (1.0, 10, 0.85, 0.42228, 0.57772, 2e5, 5e-6),
    ],
)
def test_slab_reflects_and_transmits_as_adding_doubling(
    albedo, tau, g, reflected, transmitted, photons, digits, tracker
):
    phase = mcrt.HenyeyGreenstein(g) if g else mcrt.Isotropic()
    r, t, result = shoot(tau, albedo=albedo, phase=phase, photons=photons, tracker=tracker, seed=11)
    assert result.plan.tracker == tracker
    for value, true, name in ((r, reflected, "R"), (t, transmitted, "T")):
        comparing.assert_z(
            value, true, np.hypot(comparing.fraction_error(true, photons), digits), what=name
        )
    if albedo == 1:
        assert result.energy.absorbed == 0
        assert r + t == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("axis", [1, 2])
def test_slab_reflects_the_same_along_every_axis(axis):
    photons = 2e5
    r, t, _ = shoot(
        2, axis=axis, albedo=0.9, phase=mcrt.HenyeyGreenstein(0.75), photons=photons, seed=12
    )
    comparing.assert_z(r, 0.09739, comparing.fraction_error(0.09739, photons), what="R")
    comparing.assert_z(t, 0.66096, comparing.fraction_error(0.66096, photons), what="T")


def test_unscattered_light_through_a_slab_is_exp_minus_tau():
    _, _, result = shoot(2, albedo=0.9, photons=2e5, seed=13)
    comparing.assert_z(
        result.energy.unscattered, np.exp(-2), comparing.fraction_error(np.exp(-2), 2e5)
    )


@pytest.mark.parametrize("mu0", [1.0, 0.5])
@pytest.mark.parametrize(("albedo", "tau", "photons"), [(0.5, 20, 5e5), (0.99, 60, 2e5)])
def test_half_space_reflects_by_the_h_function(albedo, tau, photons, mu0):
    r, _, _ = shoot(tau, layers=30, mu0=mu0, albedo=albedo, photons=photons, seed=14)
    true = closed_forms.half_space_reflection(albedo, mu0)
    comparing.assert_z(r, true, comparing.fraction_error(true, photons))


@pytest.mark.cpu_only("tests the truth")
def test_half_space_truth_has_the_tabulated_values():
    table = {
        (0.5, 1.0): 0.11522588,
        (0.5, 0.5): 0.16014443,
        (0.99, 1.0): 0.75272072,
        (0.99, 0.5): 0.81513990,
    }
    for (albedo, mu0), value in table.items():
        assert closed_forms.half_space_reflection(albedo, mu0) == pytest.approx(value, abs=1e-8)


# Angle-resolved: albedo 0.9, tau 2, HG 0.75, normal irradiance; I(mu), L = irradiance I(mu) / pi.
MU = np.array([0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
INTENSITY = {
    "R": np.array([0.13304, 0.13856, 0.11956, 0.09411, 0.07132, 0.06180]),
    "T": np.array([0.16486, 0.22473, 0.27785, 0.36889, 0.72155, 2.40270]),
}


def radiance(side, mu, layers, photons, seed):
    """Radiance at mu for irradiance pi, its standard error and its degrees of freedom."""
    wide = 1e5
    density, spacing = slab(2, layers, wide=wide)
    middle = np.array([wide / 2, wide / 2, 0.0 if side == "R" else 2.0])
    outward = np.array([np.sqrt(1 - mu * mu), 0.0, -mu if side == "R" else mu])
    camera = mcrt.OrthographicCamera(
        tuple(middle + 50 * outward), tuple(middle), (0, 1, 0), 1.0, (2, 2)
    )
    result = mcrt.simulate(
        density,
        spacing=spacing,
        albedo=0.9,
        phase=mcrt.HenyeyGreenstein(0.75),
        light=mcrt.DirectionalLight((0, 0, 1), np.pi),
        camera=camera,
        photons=photons,
        method="photon",
        seed=seed,
    )
    return result.image().mean(), result.image_error().mean(), comparing.dof(result, "pixel")


@pytest.mark.parametrize("side", ["R", "T"])
@pytest.mark.parametrize("i", range(len(MU)), ids=[f"mu{mu}" for mu in MU])
def test_angle_resolved_radiance_matches_adding_doubling(side, i):
    # A voxel holds the mean of its in-scattered radiance: relative bias up to (tau of a voxel /
    # mu)^2 / 20, 0.5 % at mu = 0.1 and 64 layers, and 0.1 % for the quadrature; the next test lets
    # the layers fall.
    layers = 64
    value, error, dof = radiance(side, MU[i], layers, 4e5, seed=15)
    true = INTENSITY[side][i]
    bias = true * ((2 / layers / MU[i]) ** 2 / 20 + 0.001)
    assert abs(value - true) < comparing.limit(1, dof) * error + bias, (
        f"{value} +- {error}, truth {true} +- {bias}"
    )
    assert error < 0.012 * true


@pytest.mark.parametrize("side", ["R", "T"])
def test_voxel_size_bias_of_the_radiance_falls_with_the_layers(side):
    def rms(layers):
        values = [radiance(side, mu, layers, 2e6, seed=16)[0] for mu in MU[:2]]
        return np.sqrt(np.mean((values / INTENSITY[side][:2] - 1) ** 2))

    # By 64 if it falls as the square; the noise is .3 %.
    coarse, fine = rms(4), rms(32)
    assert fine < max(coarse / 8, 0.008)
