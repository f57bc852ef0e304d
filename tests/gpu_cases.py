"""Small runs on either backend, and what they hold, for the tests of the GPU."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import mcrt
import numpy as np
import pytest
import random_scenes
from conftest import ORIGIN, SPACING, camera, density

CPU, GPU = "cpu", "gpu"
LAMP = mcrt.PointLight((30, -40, 50), 1e3)
SUN = mcrt.DirectionalLight((0.3, -0.2, -1.0), 1.0)


def run(volume=None, **arguments):
    """`simulate` on the small volume."""
    base = {
        "light": LAMP,
        "camera": camera(),
        "method": "photon",
        "progress": False,
        "backend": GPU,
    }
    if not isinstance(volume, mcrt.Medium):
        base |= {"spacing": SPACING, "origin": ORIGIN, "extinction": 0.8}
    return mcrt.simulate(density() if volume is None else volume, **(base | arguments))


def bits(result):
    """A digest of all that a result holds."""
    arrays = random_scenes.arrays(result)
    assert all(np.isfinite(array).all() for array in arrays.values())
    digest = hashlib.sha256(repr(float(result.stats.photons)).encode())
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def assert_same_fates(cpu, gpu, flips=2e-3):
    """Equal but for rounding, and for the fates of a few photons that it decides."""
    assert (cpu.plan.backend, gpu.plan.backend) == (CPU, GPU)
    assert cpu.plan.method == gpu.plan.method
    assert cpu.plan.tracker == gpu.plan.tracker
    assert cpu.stats.photons == gpu.stats.photons > 0
    here, there = random_scenes.arrays(cpu), random_scenes.arrays(gpu)
    assert not random_scenes.trouble(cpu, gpu, here, there)
    assert gpu.stats.collisions == pytest.approx(cpu.stats.collisions, rel=flips)
    differ = {name: random_scenes.difference(here[name], there[name]) for name in here}
    print(
        f"collisions {gpu.stats.collisions / max(cpu.stats.collisions, 1) - 1:.1e}; worst", end=" "
    )
    print(*max(differ.items(), key=lambda item: item[1]))
    assert max(differ.values()) < flips, differ


def python(code, **environment):
    """What another process prints."""
    paths = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    clean = {k: v for k, v in os.environ.items() if k != "MCRT_BACKEND"}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=clean | {"PYTHONPATH": paths} | environment,
        capture_output=True,
        text=True,
        check=True,
    )
