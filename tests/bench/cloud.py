"""The 128^3 trilinear cloud, 5 orders, a point light: stages, errors, the scalar walk.

Errors are RMS differences from a converged run of another seed, the reference's noise taken off,
over the mean, both over the pixels above 5 % of the maximum (as target_error counts).
"""

import functools
import os
from typing import NamedTuple
from unittest.mock import patch

import mcrt
import numpy as np
from table import heading, number, row, stages, timed

SIDE, EXTINCTION, ALBEDO, ORDERS = 128, 0.1, 0.9, 5
LIGHT = mcrt.PointLight((200, -150, 300), 1e5)
EYE, CENTRE = (400, -300, 150), (64, 64, 64)
REFERENCE = 3e7
SEEDS = range(1, 5)


def camera(side, fov=20):
    return mcrt.PerspectiveCamera(EYE, CENTRE, fov=fov, resolution=(side, side))


def scene(view, **options):
    arguments = {
        "extinction": EXTINCTION,
        "albedo": ALBEDO,
        "light": LIGHT,
        "max_scatterings": ORDERS,
        "camera": view,
        "outputs": ("image",),
        "progress": False,
    }
    return arguments | options


@functools.cache
def volume():
    return mcrt.datasets.cloud(SIDE)


@functools.cache
def reference():
    return mcrt.simulate(volume(), **scene(camera(64), photons=REFERENCE, seed=99))


@functools.cache
def truth(side):
    """The converged image and its own error: one shot serves every camera."""
    view = camera(side)
    return reference().image(view), reference().image_error(view)


class Run(NamedTuple):
    """The squared relative error of an image, and the seconds of its stages."""

    square: float
    light: float
    photons: float
    gather: float
    whole: float

    def error(self):
        return np.sqrt(max(self.square, 0.0))


def measure(side, photons, seed, simd=None):
    with patch.dict(os.environ, {"MCRT_SIMD": simd} if simd else {}):
        options = scene(camera(side), photons=photons, seed=seed)
        result, seconds = timed(mcrt.simulate, volume(), **options)
        image, gather = timed(result.image)
    expected, noise = truth(side)
    bright = expected > 0.05 * expected.max()
    square = np.mean((image - expected)[bright] ** 2) - np.mean(noise[bright] ** 2)
    relative = square / expected[bright].mean() ** 2
    spent = stages(result)
    return Run(relative, spent["light grid"], spent["photons"], gather, seconds + gather)


def typical(runs):
    """Mean of the squared errors, shortest seconds."""
    return Run(np.mean([run.square for run in runs]), *np.min(runs, axis=0)[1:])


def rows(name, run):
    row(f"{name}: error", f"{100 * run.error():.2f}", "%")
    for stage in ("light", "photons", "gather"):
        row(f"  {stage}", f"{getattr(run, stage):.3f}", "s")
    row("  in all", f"{run.whole:.3f}", "s")


def shown():
    """The README's five lines: seconds of the run, and until its result is shown."""
    light = mcrt.PointLight((200, -150, 300), intensity=1e5)
    eye = mcrt.PerspectiveCamera((250, -200, 110), target=(48, 48, 44), fov=16)
    options = {"extinction": 0.2, "albedo": 0.99, "light": light, "camera": eye, "progress": False}
    result, seconds = timed(mcrt.simulate, mcrt.datasets.cloud(96), **options)
    return seconds, timed(result._repr_html_)[1]


def run(large=False):
    heading(f"cloud, {SIDE}^3 trilinear, {ORDERS} orders, 64 x 64 ({len(SEEDS)} seeds)")
    measure(64, 1e5, 0)  # warms up
    rows("5e5 photons", typical([measure(64, 5e5, seed) for seed in SEEDS]))
    pairs = [[measure(64, 1.5e6, seed, simd) for simd in (None, "scalar")] for seed in SEEDS]
    ours, scalar = (typical(side) for side in zip(*pairs, strict=True))
    rows("1.5e6 photons", ours)
    rows("1.5e6 photons, scalar walk", scalar)
    walk = scalar.square * scalar.photons / (ours.square * ours.photons)
    row("figure of merit of the photons over the scalar walk's", number(walk), "x")
    whole = scalar.square * scalar.whole / (ours.square * ours.whole)
    row("figure of merit of the whole over the scalar walk's", number(whole), "x")
    result = mcrt.simulate(volume(), **scene(camera(64), photons=1.5e6))
    gathers = [timed(result.image, camera(600, fov))[1] for fov in (20, 20.01, 20.02)]
    row("gather 600 x 600", f"{min(gathers):.3f}", "s")
    seconds, shows = np.min([shown() for _ in range(3)], axis=0)
    row("the README's five lines: run", f"{seconds:.3f}", "s")
    row("  shown after it", f"{shows:.3f}", "s")
