"""A point source in an infinite medium: a box so large that what escapes is below 1e-4 of the
numbers tested.

False alarms: 1e-5 per assertion, about 15 assertions. The standard errors are those of analog
absorption, sqrt(p (1 - p) / N) for a fraction and sqrt(<r^2n> - <r^n>^2) / sqrt(N) for a moment:
weights only lower them.
"""

import closed_forms
import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached

WATT = 1 / (4 * np.pi)  # intensity of a point light of 1 W
ALBEDO, H, CELLS = 0.9, 0.25, 97  # odd: the light stands on a voxel centre
CENTRE = (CELLS * H / 2,) * 3
PHOTONS = 1e6


@cached
def diffusing():
    """sigma_t = 1, isotropic scattering of albedo 0.9."""
    return mcrt.simulate(
        np.ones((CELLS,) * 3, np.float32),
        spacing=H,
        albedo=ALBEDO,
        light=mcrt.PointLight(CENTRE, WATT),
        photons=PHOTONS,
        outputs=["fluence"],
        errors=False,
        method="photon",
        seed=21,
    )


@pytest.mark.parametrize(("radius", "true"), [(1, 0.14772109), (2, 0.33533473), (5, 0.76005454)])
def test_absorption_within_a_radius_is_that_of_an_infinite_medium(radius, true):
    assert closed_forms.infinite_absorbed(radius, ALBEDO) == pytest.approx(true, abs=1e-7)
    value = closed_forms.within_ball(np.asarray(diffusing().absorbed, float), H, CENTRE, radius)
    # 0.1 %: voxels cut by the sphere (0.07 % at radius 1, measured on the exact voxel means).
    comparing.assert_z(value, true, comparing.fraction_error(true, PHOTONS), relative=1e-3)


@pytest.mark.parametrize(("r", "true"), [(1, 0.1432839), (2, 0.0371264), (5, 0.002915125)])
def test_fluence_at_a_distance_is_that_of_case_de_hoffmann_and_placzek(r, true):
    assert closed_forms.infinite_fluence(r, ALBEDO) == pytest.approx(true, rel=1e-6)
    points, weight = truth.voxel_nodes((CELLS,) * 3, H, 1)
    distance = np.linalg.norm(points[..., 0, :] - CENTRE, axis=-1)
    shell = np.abs(distance - r) < H
    k, j, i = np.nonzero(shell)
    # The exact mean of every voxel in the shell, by Gauss nodes.
    node, weight = np.polynomial.legendre.leggauss(3)
    offset = np.stack(np.meshgrid(node, node, node, indexing="ij"), -1).reshape(-1, 3) * H / 2
    weight = (weight[:, None, None] * weight[:, None] * weight).ravel() / 8
    corner = np.stack([i, j, k], -1)[:, None, :] * H + H / 2 - np.array(CENTRE) + offset
    rho = np.linalg.norm(corner, axis=-1)
    grid = np.linspace(rho.min(), rho.max(), 400)
    mean = (
        np.interp(rho, grid, closed_forms.infinite_fluence(grid, ALBEDO) * grid**2)
        / rho**2
        * weight
    ).sum(-1)
    ratio = diffusing().fluence[shell].sum(dtype=float) / mean.sum()
    absorbed = (1 - ALBEDO) * mean.sum() * H**3
    comparing.assert_z(
        ratio * true,
        true,
        comparing.fraction_error(absorbed, PHOTONS) / absorbed * true,
    )


def test_fluence_around_the_light_is_spherical():
    # Shares of the absorbed power in the six pyramids over the faces: 1/6 each, in a cube around
    # the light.
    absorbed = np.asarray(diffusing().absorbed, float)
    share = [
        half.sum()
        for axis in range(3)
        for half in np.split(absorbed, [CELLS // 2, CELLS // 2 + 1], axis)[::2]
    ]
    middle = [np.take(absorbed, CELLS // 2, axis).sum() for axis in range(3)]
    true = (absorbed.sum() - np.mean(middle)) / 2 * H**3
    comparing.assert_z(np.array(share) * H**3, true, comparing.fraction_error(true, PHOTONS))


@pytest.mark.parametrize(
    ("phase", "g1", "g2", "cells", "h"),
    [
        (mcrt.Isotropic, 0, 0, 60, 0.1),
        (mcrt.Rayleigh, 0, 0.1, 60, 0.1),
        (lambda: mcrt.HenyeyGreenstein(0.75), 0.75, 0.75**2, 80, 0.15),
        (lambda: mcrt.HenyeyGreenstein(-0.5), -0.5, 0.25, 60, 0.1),
    ],
    ids=["isotropic", "rayleigh", "hg0.75", "hg-0.5"],
)
def test_moments_of_absorption_follow_the_legendre_moments(phase, g1, g2, cells, h):
    photons, sigma_a, sigma_s = 8e5, 1, 9
    centre = (cells * h / 2,) * 3
    result = mcrt.simulate(
        np.ones((cells,) * 3, np.float32),
        spacing=h,
        extinction=sigma_a + sigma_s,
        albedo=sigma_s / (sigma_a + sigma_s),
        phase=phase(),
        light=mcrt.PointLight(centre, WATT),
        photons=photons,
        outputs=["fluence"],
        errors=False,
        method="photon",
        seed=22,
    )
    r2, r4 = closed_forms.binned_moments(np.asarray(result.absorbed, float), h, centre)
    true2, true4 = closed_forms.moments(sigma_a, sigma_s, g1, g2)
    # 0.1 %: what Sheppard's corrections leave of the light's 1/r^2 (0.08 %, measured on exact voxel
    # means).
    comparing.assert_z(
        r2, true2, np.sqrt((true4 - true2**2) / photons), relative=1e-3, what="<r^2>"
    )
    # <r^8> / <r^4>^2 is 25 where the density falls as exp(-r / l) / r.
    comparing.assert_z(r4, true4, np.sqrt(24 / photons) * true4, relative=1e-3, what="<r^4>")
    # One tally, added up in two ways.
    assert np.asarray(result.absorbed, float).sum() * h**3 == pytest.approx(
        result.energy.absorbed, rel=1e-6
    )


@pytest.mark.cpu_only("tests the truth")
def test_moment_formulas_have_the_tabulated_values():
    assert closed_forms.moments(1, 9, 0, 0) == pytest.approx((0.2, 0.144))
    assert closed_forms.moments(1, 9, 0, 0.1) == pytest.approx((0.2, 0.145055), abs=1e-6)
    assert closed_forms.moments(1, 9, 0.75, 0.5625) == pytest.approx((0.615385, 1.466856), abs=1e-6)
