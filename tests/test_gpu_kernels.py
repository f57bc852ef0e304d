"""A kernel is compiled once for a kind of scene: numbers are what it reads, not what it is made of.

Nothing here depends on chance.
"""

import mcrt
import numpy as np
import pytest
from gpu_cases import GPU, run
from mcrt import _mcrt

pytestmark = [
    pytest.mark.cpu_only("only a GPU has kernels"),
    pytest.mark.usefixtures("adapter"),
]
OTHER = mcrt.OrthographicCamera((60, 0, 0), (6, 6, 6), width=20, resolution=(5, 5))
FIRST = {"shape": (12, 12, 12), "extinction": 0.6, "albedo": 0.9, "spacing": 1.0}
SWEEPS = (
    {"shape": (10, 14, 12)},
    {"shape": (11, 12, 17)},
    {"extinction": 0.5},
    {"albedo": 0.8},
    {"spacing": (0.9, 0.7, 0.8)},
)
PATH = {"method": "path", "spp": 1}


def hg(g):
    return mcrt.HenyeyGreenstein(g)


def table(knots):
    cosines = np.linspace(-1.0, 1.0, knots)
    return mcrt.TabulatedPhase(cosines, 2.0 + cosines)


G = (0.6, -0.5, 0.1, 0.8, 0.95)
KINDS = {
    "photons": ({}, hg, G),
    "harmonics": ({"angular": 2}, hg, G[:2]),
    "paths": (PATH, hg, G),
    "a table": (PATH, table, (3, 4, 33)),
    "what glows": ({"emission": (0.1, 0.2, 0.3), "light": ()}, hg, G[:2]),
}


def sweep(kind):
    """Runs of one kind of scene that differ by numbers."""
    options, phase, numbers = KINDS[kind]
    for number in numbers:
        yield {**FIRST, **options, "phase": phase(number)}
    for change in SWEEPS:
        if not set(options) & set(change):
            yield {**FIRST, **options, **change, "phase": phase(numbers[0])}


def shown(shape, **options):
    eye = mcrt.PerspectiveCamera((30, -25, 20), (6, 6, 6), fov=28, resolution=(6, 6))
    volume = 0.5 + np.random.default_rng(1).random(shape, dtype=np.float32)
    if "spp" not in options:
        options["photons"] = 200
    options["outputs"] = ("image",)
    options = {"origin": (0, 0, 0), "light": mcrt.DirectionalLight((0.3, -0.2, -1))} | options
    result = run(volume, camera=eye, **options)
    assert np.isfinite(result.image()).all()
    if "angular" in options:
        result.image(OTHER)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_compile_no_kernel(kind):
    first, *others = sweep(kind)
    shown(**first)
    before, _ = _mcrt.kernels(GPU)
    for other in others:
        shown(**other)
    assert _mcrt.kernels(GPU)[0] == before > 0
