"""Paths in spheres and boxes without voxels: chords, quadrature, the limit of voxels.

False alarms: 1e-5 per assertion (Bonferroni over pixels), about 250 assertions in the tests of
paths together: 0.25 %.
"""

import comparing
import mcrt
import numpy as np
import pytest
import truth
from path_cases import SIMDS, SUN, assert_image, lit, run
from truth import Point, View

BALL = View((-9, -14, 12), (0.3, -0.2, 0.1), (6, 5), width=4.4)


def ball_rays(view, radius, n=40):
    """Chords of a sphere about 0: rays of each pixel, entries and exits; equal weights."""
    w, h = view.resolution
    row, column, j, i = np.indices((h, w, n, n)).reshape(4, h, w, n * n)
    o, d = view.through(column + (i + 0.5) / n, row + (j + 0.5) / n)
    b = (o * d).sum(-1)
    root = b * b - (o * o).sum(-1) + radius**2
    hit = root > 0
    root = np.sqrt(np.maximum(root, 0))
    near = np.maximum(-b - root, 0)
    return o, d, near, np.maximum(-b + root, near), hit


FINE = View((-9, -14, 12), (0.3, -0.2, 0.1), (42, 35), width=4.4)
WITHIN = View((0.3, 0.5, -0.2), (1, 0, 0), (4, 3), fov=80)


@pytest.mark.parametrize("view", [BALL, FINE, WITHIN], ids=["coarse", "fine", "within"])
@pytest.mark.parametrize("sigma", [0.3, 2.0])
def test_alpha_of_a_sphere_is_one_less_the_transmittance_of_its_chords(sigma, view):
    result = run(mcrt.Medium.sphere(1.7, extinction=sigma), light=(), camera=view.camera(), spp=8)
    _, _, near, far, hit = ball_rays(view, 1.7, 30 if view is FINE else 100)
    true = np.where(hit, -np.expm1(-sigma * (far - near)), 0).mean(-1)
    # Deterministic, from some rays a pixel: 1 % where a rim crosses pixels, as images of voxels.
    assert comparing.relative_rms(result.alpha(), true) < (0.005 if view is WITHIN else 0.01)


@pytest.mark.parametrize("pixels", [4, 8, 16, 32])
def test_alpha_of_a_box_is_one_less_the_transmittance_of_its_chords(pixels):
    view = View((-9, -14, 12), (1.2, 1.2, 1.2), (pixels, pixels), width=4.4)
    result = run(mcrt.Medium.box(2.4), light=(), camera=view.camera(), spp=8)
    true = truth.transmittance_image(view, np.ones((1, 1, 1)), (2.4, 2.4, 2.4), sub=24)
    assert comparing.relative_rms(result.alpha(), 1 - true) < 0.01  # edges cross all pixels


@pytest.mark.parametrize("simd", SIMDS)
@pytest.mark.parametrize("sigma", [0.3, 2.0])
@pytest.mark.parametrize("view", [BALL, WITHIN])
def test_order_1_of_a_sphere_is_its_quadrature(sigma, view, simd, monkeypatch):
    monkeypatch.setenv("MCRT_SIMD", simd)
    ball = mcrt.Medium.sphere(1.7, extinction=sigma, albedo=0.9, phase=mcrt.HenyeyGreenstein(0.3))
    o, d, near, far, hit = ball_rays(view, 1.7)
    node, w = np.polynomial.legendre.leggauss(24)
    t = near[..., None] + (far - near)[..., None] * (node + 1) / 2
    p = o[..., None, :] + t[..., None] * d[..., None, :]
    for light in (SUN, Point((6.0, -3.0, 4.0), 30.0), Point((0.2, 0.1, 2.6), 3.0)):
        result = run(
            ball,
            light=lit(light),
            camera=view.camera(),
            max_scatterings=1,
            spp=24_000,
        )
        if isinstance(light, Point):
            travel = p - np.asarray(light.position)
            distance = np.linalg.norm(travel, axis=-1)
            travel, falloff = travel / distance[..., None], light.intensity / distance**2
        else:
            travel = np.divide(light.direction, np.linalg.norm(light.direction)) * np.ones_like(p)
            falloff = light.irradiance
        b = -(p * travel).sum(-1)
        back = -b + np.sqrt(np.maximum(b * b - (p * p).sum(-1) + 1.7**2, 0))
        cosine = -(travel * d[..., None, :]).sum(-1)
        value = truth.hg(0.3)(cosine) * falloff * np.exp(-sigma * (t - near[..., None] + back))
        true = 0.9 * sigma * (value * w / 2).sum(-1) * (far - near)
        true = np.where(hit, true, 0).mean(-1)
        assert_image(result, true, largest=0.004, what=f"{light}")


def test_a_sphere_is_the_limit_of_voxels():
    """A ball of 64^3 voxels, half of them cut by its surface wrong by half a voxel at most."""
    n, radius = 64, 1.6
    z, y, x = (np.indices((n, n, n)) + 0.5) / n * 4 - 2
    voxels = (z * z + y * y + x * x < radius**2).astype(np.float32)
    view = View((9, -7, 5), (0, 0, 0), (4, 4), width=1.6)
    common = {"light": lit(SUN), "camera": view.camera(), "spp": 8000}
    ball = run(mcrt.Medium.sphere(radius, extinction=1.5, albedo=0.95), **common)
    cubes = run(
        voxels,
        spacing=4 / n,
        origin=(-2, -2, -2),
        interpolation="nearest",
        extinction=1.5,
        albedo=0.95,
        seed=1,
        **common,
    )
    # Volumes agree within 2e-3; the stairs of the surface tilt no light, for it does not refract.
    assert_image(ball, cubes.image(), cubes.image_error(), relative=5e-3)
