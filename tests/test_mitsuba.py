"""Images against those of Mitsuba 3's `volpath`, an independent path tracer.

Order 1 (`max_depth` 2) and orders 1 to 5 (`max_depth` 6) of volumes with three unequal extents and
spacings, a point light outside. The measure is the relative RMS difference beyond both noises,

    sqrt(mean(d^2) - mean(variance of ours) - mean(variance of Mitsuba's)) / mean(image),

each variance from independent seeds. Required is 1 %; the standard error of its square, from the
spread of the pixels, is at most ERROR = 0.15e-4, so that an image with half the allowed difference
passes by 5 of them: false alarms below 1e-6 per comparison. Image means: `truth.ALPHA` each.

Mitsuba runs compiled where LLVM 19 is found (see `conftest`), else as `scalar_rgb`, three times
slower.
"""

import functools
import os
from dataclasses import dataclass

import drjit
import mcrt
import mitsuba as mi
import numpy as np
import pytest
import truth
from scipy import stats

pytestmark = pytest.mark.validation

SHAPE, SPACING = (24, 20, 16), (0.3, 0.25, 0.5)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # x, y, z = 8, 5, 7.2
LIGHT, INTENSITY = (20.0, 14.0, 16.0), 300.0
VIEW = truth.View((-6, -17, 12), (4.2, 2.3, 3.5), (32, 24), fov=24)
BOUND, ERROR = 0.01, 0.15e-4  # of the RMS difference; of its square
SEEDS = 4  # of ours; Mitsuba's are in the table


def ones():
    return np.ones(SHAPE, np.float32)


def cloud():
    """Blobs several voxels wide, cut by the border at some faces, with voids between them."""
    z, y, x = (np.reshape((np.arange(n) + 0.5) / n, s) for n, s in zip(SHAPE, AXES, strict=True))
    total = sum(
        weight * np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius**2)
        for cx, cy, cz, radius, weight in BLOBS
    )
    return np.clip(total - 0.25, 0, None).astype(np.float32)


AXES = (-1, 1, 1), (1, -1, 1), (1, 1, -1)
BLOBS = [  # x, y, z of the centre, radius, weight
    (0.30, 0.35, 0.35, 0.35, 0.9),
    (0.70, 0.65, 0.50, 0.40, 0.8),
    (0.85, 0.25, 0.85, 0.45, 0.7),
    (0.15, 0.80, 0.95, 0.35, 0.6),
]


@dataclass(frozen=True)
class Case:
    volume: callable
    extinction: float
    g: float
    interpolation: str
    seeds: int  # Mitsuba's, of SAMPLES samples per pixel
    albedo: float = 0.9


SAMPLES = 1024
CASES = {
    "homogeneous": Case(ones, 0.4, 0.0, "linear", 16),
    "cloud": Case(cloud, 0.5, 0.5, "linear", 16),
    "voxels": Case(cloud, 0.5, 0.5, "nearest", 16),
}
ORDERS = [1, 5]


@dataclass(frozen=True)
class Images:
    """Independent images of one scene, (seeds, height, width)."""

    runs: np.ndarray

    @property
    def mean(self):
        return self.runs.mean(0)

    @property
    def variance(self):
        """Of the mean; of a deterministic image, 0."""
        n = len(self.runs)
        return self.runs.var(0, ddof=1) / n if n > 1 else np.zeros_like(self.runs[0])


# ------------------------------------------------------------------------------------------ Mitsuba


def select_variant():
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and drjit.has_backend(drjit.JitBackend.LLVM)
    mi.set_variant("llvm_ad_mono" if llvm else "scalar_rgb")


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


@functools.cache
def reference(name, order):
    select_variant()
    case = CASES[name]
    scene = mi.load_dict(mitsuba_scene(case, order))
    runs = [
        np.array(mi.render(scene, spp=SAMPLES, seed=seed), float)[..., 0]
        for seed in range(case.seeds)
    ]
    return Images(np.stack(runs))


# --------------------------------------------------------------------------------------- comparison


def ours(case, order, volume=None):
    options = (
        {"method": "single"}
        if order == 1
        else {"method": "photon", "photons": 1e6, "errors": False, "outputs": None}
    )
    runs = [
        mcrt.simulate(
            case.volume() if volume is None else volume,
            spacing=SPACING,
            interpolation=case.interpolation,
            extinction=case.extinction,
            albedo=case.albedo,
            phase=mcrt.HenyeyGreenstein(case.g),
            light=mcrt.PointLight(LIGHT, INTENSITY),
            camera=VIEW.camera(),
            max_scatterings=order,
            seed=seed,
            **options,
        ).image()
        for seed in range(1 if order == 1 else SEEDS)
    ]
    return Images(np.stack(runs).astype(float))


def excess(images, true):
    """The squared relative RMS difference beyond both noises, and its standard error."""
    square = (images.mean - true.mean) ** 2 - images.variance - true.variance
    scale = true.mean.mean() ** 2
    return square.mean() / scale, stats.sem(square, axis=None) / scale
