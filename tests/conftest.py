"""Shared set-up: libraries that need an environment, and small runs that many tests read."""

import glob
import os

import numpy as np
import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
_LLVM = sorted(glob.glob("/usr/lib/*/libLLVM*19*") + glob.glob("/usr/lib/llvm-19/lib/libLLVM*.so*"))
if _LLVM:  # Dr.Jit aborts with LLVM 15 and 16, which it may find first
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", _LLVM[0])

import mcrt  # noqa: E402

SHAPE, SPACING, ORIGIN = (4, 5, 6), (1.5, 1.0, 0.5), (10.0, -20.0, 30.0)
EYE = (25.0, -5.0, 40.0)
CENTRE = (11.5, -17.5, 33.0)


def density(seed=0):
    """A small heterogeneous volume of three unequal extents, with empty voxels."""
    values = np.random.default_rng(seed).random(SHAPE, dtype=np.float32)
    values[values < 0.2] = 0.0
    return values


def camera(eye=EYE, resolution=(14, 10)):
    return mcrt.PerspectiveCamera(eye, CENTRE, fov=25.0, resolution=resolution)


def run(volume=None, **arguments):
    """`simulate` on the small volume, with few photons."""
    defaults = {
        "spacing": SPACING,
        "origin": ORIGIN,
        "extinction": 0.8,
        "light": mcrt.PointLight((30.0, -40.0, 50.0), 1e3),
        "camera": camera(),
        "photons": 4000,
        "max_scatterings": 5,
        "method": "photon",
        "progress": False,
    }
    return mcrt.simulate(density() if volume is None else volume, **(defaults | arguments))


@pytest.fixture(scope="session")
def grey():
    return run()


@pytest.fixture(scope="session")
def rgb():
    return run(albedo=(0.9, 0.6, 0.3))
