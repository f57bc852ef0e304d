"""Images against those of Mitsuba 3's `volpath`, an independent path tracer.

Order 1 (`max_depth` 2) and orders 1 to 5 (`max_depth` 6) of volumes with three unequal extents and
spacings, lit by a point light outside. The measure is the relative RMS difference beyond both
noises,

    sqrt(mean(d^2) - mean(variance of ours) - mean(variance of Mitsuba's)) / mean(image),

the variances from independent seeds on both sides. Required is 1 %. With four to ten times the
samples it is 0.3 to 0.4 % for the homogeneous volume (edges of the box in coarse pixels) and for
orders 1 to 5 of the others, and 0.6 % for their order 1 (the light's optical depth is interpolated
between voxel corners). The standard error of its square is 0.2e-4 at most, a fifth of the bound's.
Image means differ by MEAN_BIAS at most, which is for the same interpolation and the voxels' size,
beside the noise (false alarms: `comparing.ALPHA` each).

Everything is fixed by seeds. Mitsuba's side is kept (`mitsuba_stored`). It runs compiled where
LLVM 19 is found (`conftest` looks for it), else as `scalar_rgb`, about half as fast, with half the
seeds.
"""

import functools
import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import comparing
import drjit
import mcrt
import mitsuba as mi
import numpy as np
import pytest
import truth
from mitsuba_stored import Job, digest, estimate, stored

SHAPE, SPACING = (24, 20, 16), (0.3, 0.25, 0.5)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # x, y, z = 8, 5, 7.2
LIGHT, INTENSITY = (20.0, 14.0, 16.0), 300.0
VIEW = truth.View((-6, -17, 12), (4.2, 2.3, 3.5), (32, 24), fov=24)
BOUND, MEAN_BIAS = 0.01, 0.003
SEEDS, PHOTONS = 16, 2e5  # ours
SAMPLES = 1024  # Mitsuba's, per pixel and seed
ORDERS = [1, 5]


def ones():
    return np.ones(SHAPE, np.float32)


BLOBS = [  # x, y, z of the centre and radius, in extents of the box; weight
    (0.30, 0.35, 0.35, 0.35, 0.9),
    (0.70, 0.65, 0.50, 0.40, 0.8),
    (0.85, 0.25, 0.85, 0.45, 0.7),
    (0.15, 0.80, 0.95, 0.35, 0.6),
]


def cloud():
    """Blobs several voxels wide, some cut by the border, with voids between them; no symmetry."""
    z, y, x = np.meshgrid(*((np.arange(n) + 0.5) / n for n in SHAPE), indexing="ij")
    total = sum(
        weight * np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius**2)
        for cx, cy, cz, radius, weight in BLOBS
    )
    return np.clip(total - 0.25, 0, None).astype(np.float32)


@dataclass(frozen=True)
class Case:
    volume: Callable[[], np.ndarray]
    interpolation: str
    extinction: float
    albedo: float
    g: float
    seeds: int  # Mitsuba's


CASES = {
    "homogeneous": Case(ones, "linear", 0.4, 0.9, 0.0, 16),
    "cloud": Case(cloud, "linear", 0.5, 0.9, 0.5, 32),
    "voxels": Case(cloud, "nearest", 0.5, 0.9, 0.5, 16),
}
WRONG = {  # what ours is given instead of the case; each alone is seen
    "extinction + 3 %": lambda case: replace(case, extinction=1.03 * case.extinction),
    "extinction - 3 %": lambda case: replace(case, extinction=0.97 * case.extinction),
    "g + 0.1": lambda case: replace(case, g=case.g + 0.1),
    "g - 0.1": lambda case: replace(case, g=case.g - 0.1),
    "z flipped": lambda case: replace(case, volume=lambda: flipped(case, 0)),
    "y flipped": lambda case: replace(case, volume=lambda: flipped(case, 1)),
    "x flipped": lambda case: replace(case, volume=lambda: flipped(case, 2)),
}


def flipped(case, axis):
    return np.ascontiguousarray(np.flip(case.volume(), axis))


def features(images):
    """The mean of each image (n, h, w) and then its pixels, (n, 1 + h w)."""
    pixels = np.asarray(images, float).reshape(len(images), -1)
    return np.concatenate([pixels.mean(1, keepdims=True), pixels], 1)


# ------------------------------------------------------------------------------------------ Mitsuba


def select_variant():
    """True: compiled by LLVM, of the version that `conftest` chose."""
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and drjit.has_backend(drjit.JitBackend.LLVM)
    mi.set_variant("llvm_ad_mono" if llvm else "scalar_rgb")
    return llvm


def grey(value):
    return {"type": "rgb", "value": value}


def medium(case):
    phase = {"type": "hg", "g": case.g} if case.g else {"type": "isotropic"}
    optical = {"albedo": grey(case.albedo), "phase": phase}
    if case.volume is ones:
        return {"type": "homogeneous", "sigma_t": grey(case.extinction)} | optical
    grid = {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(case.volume()[..., None]),
        "filter_type": {"linear": "trilinear", "nearest": "nearest"}[case.interpolation],
        "raw": True,
        "accel": False,
        "to_world": mi.ScalarTransform4f().scale(mi.ScalarPoint3f(*SIZE)),
    }
    return {"type": "heterogeneous", "sigma_t": grid, "scale": case.extinction} | optical


def mitsuba_scene(case, order):
    transform = mi.ScalarTransform4f
    width, height = VIEW.resolution
    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": order + 1, "rr_depth": 100_000},
        "sensor": {
            "type": "perspective",
            "fov": VIEW.fov,
            "fov_axis": "x",
            "to_world": transform().look_at(origin=VIEW.origin, target=VIEW.target, up=VIEW.up),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
                "component_format": "float32",
            },
        },
        "light": {"type": "point", "position": LIGHT, "intensity": grey(INTENSITY)},
        "box": {  # [-1, 1]^3 to the grid's bounding box
            "type": "cube",
            "to_world": transform().scale(mi.ScalarPoint3f(*SIZE / 2)).translate([1, 1, 1]),
            "bsdf": {"type": "null"},
            "interior": medium(case),
        },
    }


def render(name, order, seeds):
    """Features of Mitsuba's images."""
    llvm = select_variant()
    scene = mi.load_dict(mitsuba_scene(CASES[name], order))
    seeds = seeds if llvm else seeds[: len(seeds) // 2]
    renders = [np.array(mi.render(scene, spp=SAMPLES, seed=seed)) for seed in seeds]
    return features(np.stack(renders)[..., 0])


def job(name, order):
    select_variant()
    case = CASES[name]
    return Job(
        f"{name}, orders 1 to {order}",
        digest(mitsuba_scene(case, order), SAMPLES, case.seeds, mi.__version__),
        case.seeds,
        functools.partial(render, name, order),
    )


def jobs():
    """What Mitsuba renders for this file."""
    return [job(name, order) for name in CASES for order in ORDERS]


# --------------------------------------------------------------------------------------- comparison


def ours(case, order):
    single = order == 1  # deterministic
    options = {"method": "single"} if single else {"method": "photon", "photons": PHOTONS}
    runs = [
        mcrt.simulate(
            case.volume(),
            spacing=SPACING,
            interpolation=case.interpolation,
            extinction=case.extinction,
            albedo=case.albedo,
            phase=mcrt.HenyeyGreenstein(case.g),
            light=mcrt.PointLight(LIGHT, INTENSITY),
            camera=VIEW.camera(),
            max_scatterings=order,
            seed=seed,
            errors=False,
            outputs=["image"],
            **options,
        ).image()
        for seed in range(1 if single else SEEDS)
    ]
    return estimate(features(runs))


def rms_beyond_noise(ours, true):
    square = (ours.mean - true.mean) ** 2 - ours.variance - true.variance
    return np.sqrt(max(0.0, square[1:].mean())) / true.mean[0]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", CASES)
def test_image_is_that_of_mitsuba(name, order):
    found, true = ours(CASES[name], order), stored(job(name, order))
    rms = rms_beyond_noise(found, true)
    difference = found.mean[0] / true.mean[0] - 1
    noise = [np.sqrt(one.variance) / true.mean[0] for one in (found, true)]
    error = np.hypot(noise[0][0], noise[1][0])
    print(
        f"{name}, orders 1 to {order}: RMS beyond noise {rms:.2%} (noise of ours "
        f"{np.sqrt((noise[0][1:] ** 2).mean()):.2%}, of Mitsuba "
        f"{np.sqrt((noise[1][1:] ** 2).mean()):.2%}), mean {difference:+.2%} +- {error:.2%}"
    )
    assert rms < BOUND
    dof = min(one.count for one in (found, true) if one.count > 1) - 1
    assert abs(difference) < MEAN_BIAS + comparing.limit(dof=dof) * error


@pytest.mark.cpu_only("how sharp the comparison is does not depend on the backend")
@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_parameter_breaks_the_bound(wrong):
    found = ours(WRONG[wrong](CASES["cloud"]), ORDERS[-1])
    assert rms_beyond_noise(found, stored(job("cloud", ORDERS[-1]))) > 1.5 * BOUND
