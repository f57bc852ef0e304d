"""What the tests of paths share: scenes, and the comparison of an image with its truth."""

import functools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import gappy
from scipy import stats
from truth import Directional, Point, View

SHAPE, SPACING = (5, 6, 7), (1.1, 0.6, 0.8)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # 5.6, 3.6, 5.5
VIEW = View((-9, -14, 12), (2.8, 1.8, 2.7), (4, 3), fov=9)
INSIDE = View((1.3, 0.9, 2.2), (3.9, 2.0, 1.1), (4, 3), fov=70)
FLAT = View((14, -9, 11), (2.8, 1.8, 2.7), (4, 3), width=2.0)
FAR, SUN = Point((14, -7, 16), 300.0), Directional((-0.4, 0.5, -0.8), 2.0)
PHASES = {
    "isotropic": (mcrt.Isotropic(), truth.isotropic),
    "rayleigh": (mcrt.Rayleigh(), truth.rayleigh),
    "hg0.8": (mcrt.HenyeyGreenstein(0.8), truth.hg(0.8)),
}
ALMOST = np.ones((6, 8, 3), np.float32)
ALMOST[0, 0] += 1e-6
SCALAR = pytest.mark.cpu_only("lanes are the CPU's")
SIMDS = ["", pytest.param("scalar", marks=SCALAR)]
BEYOND = ["avx2", "avx512"]  # instruction sets beyond what every processor has


def ways(names):
    """Names of scenes, of which those of the scalar walk are the CPU's."""
    return [pytest.param(name, marks=SCALAR if "scalar" in name else ()) for name in names]


def need(simd):
    """Skips a test on a processor that lacks an instruction set, in whose stead it takes others."""
    known = ["baseline", *BEYOND]
    best = mcrt._mcrt.info()["simd"]
    if known.index(best) < known.index(simd):
        pytest.skip(f"this processor has {best} at most, not {simd}")


def run(volume, **options):
    return mcrt.simulate(volume, **{"method": "path", "progress": False} | options)


def cloud(seed=41):
    return gappy(SHAPE, seed)


def smooth():
    """One blob of a few voxels' width: what photons' voxels blur little."""
    z, y, x = np.indices((12, 12, 12)) - 5.5
    return np.exp(-(z**2 + 0.8 * y**2 + 1.2 * x**2) / 18).astype(np.float32)


def homogeneous(box, sigma, phase):
    """A volume and its options: a box without voxels, or an array of ones."""
    options = {"extinction": sigma, "albedo": 0.9, "phase": phase}
    if box:
        return mcrt.Medium.box(SIZE, **options), {}
    return np.ones(SHAPE), options | {"spacing": SPACING}


def lit(light):
    if isinstance(light, Point):
        return mcrt.PointLight(light.position, light.intensity)
    return mcrt.DirectionalLight(light.direction, light.irradiance)


def way(plan, name):
    return next(choice for key, choice, _ in plan.decisions if key == name)


def assert_image(result, true, true_error=0.0, *, relative=2e-4, largest=None, what=""):
    """Every pixel is right, and their mean, which is sharper; `largest` bounds its relative error.

    `result` may be an image and its errors instead.
    """
    image, error = result if isinstance(result, tuple) else (result.image(), result.image_error())
    true = np.broadcast_to(np.asarray(true, float), image.shape)
    true_error = np.broadcast_to(true_error, image.shape)
    comparing.assert_z(image, true, error, true_error, relative=relative, what=what)
    pixels = tuple(range(2))  # by channel
    total = np.sqrt(np.sum(np.square(error, dtype=float), pixels)) / np.prod(image.shape[:2])
    spread = np.sqrt(np.sum(true_error**2, pixels)) / np.prod(image.shape[:2])
    mean = np.atleast_1d(image.mean(pixels, dtype=float))
    comparing.assert_z(
        mean, true.mean(pixels), total, spread, relative=relative, what=f"{what} mean"
    )
    if largest is not None:
        assert np.all(total < largest * np.abs(mean)), f"{what}: {total / mean}"


def pooled(*terms):
    """The sum of images, and its errors."""
    return sum(r.image() for r in terms), np.sqrt(sum(r.image_error() ** 2.0 for r in terms))


def order_one(density, spacing, linear, view, light, albedo, pdf, cells=(5, 5, 20), repeats=8):
    """Order 1 of a voxel volume: stratified sampling, its mean and standard error by pixel."""
    rng, (w, h) = np.random.default_rng(3), view.resolution
    size = np.multiply(density.shape, spacing)[::-1]
    n = np.prod(cells)
    images = []
    for _ in range(repeats):
        at = (np.indices(cells).reshape(3, n) + rng.random((h, w, 3, n))) / np.reshape(
            cells, (3, 1)
        )
        row, column = np.indices((h, w))
        o, d = view.through(column[..., None] + at[..., 0, :], row[..., None] + at[..., 1, :])
        near, far = truth.box_interval(o, d, size)
        hit = far > near
        far = np.where(hit, far, near)
        if isinstance(light, Point):
            to = np.asarray(light.position, float) - o
            foot = (to * d).sum(-1)
            off = np.linalg.norm(to - foot[..., None] * d, axis=-1)
            low, high = np.arctan2(near - foot, off), np.arctan2(far - foot, off)
            angle = low + (high - low) * at[..., 2, :]
            t, dt = foot + off * np.tan(angle), (high - low) * off / np.cos(angle) ** 2
        else:
            t, dt = near + (far - near) * at[..., 2, :], far - near
        p = o + t[..., None] * d
        if isinstance(light, Point):
            travel = p - np.asarray(light.position, float)
            distance = np.linalg.norm(travel, axis=-1)
            travel, falloff = travel / distance[..., None], light.intensity / distance**2
        else:
            travel = np.broadcast_to(
                np.divide(light.direction, np.linalg.norm(light.direction)), p.shape
            )
            distance, falloff = np.inf, light.irradiance
        _, back = truth.box_interval(p, -travel, size)
        back = np.minimum(back, distance)
        tau = truth.optical_depth(density, spacing, o + near[..., None] * d, p, linear)
        tau = tau + truth.optical_depth(density, spacing, p, p - back[..., None] * travel, linear)
        here = truth.density_at(density, spacing, p, linear)
        value = pdf(-(travel * d).sum(-1)) * falloff * here * np.exp(-tau) * dt
        images.append(albedo * np.where(hit, value, 0).mean(-1))
    return np.mean(images, 0), stats.sem(images)


@functools.cache
def voxels(interpolation, light, view, extinction):
    density = extinction * cloud().astype(float)
    return order_one(density, SPACING, interpolation == "linear", view, light, 0.9, truth.hg(0.3))
