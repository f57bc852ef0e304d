"""Paths under environments and in emitting media: white furnaces, equilibria, maps.

False alarms: 1e-5 per assertion (Bonferroni over pixels), about 250 assertions in the tests of
paths together: 0.25 %.
"""

import mcrt
import numpy as np
import pytest
from path_cases import (
    ALMOST,
    INSIDE,
    SHAPE,
    SIMDS,
    SIZE,
    SPACING,
    VIEW,
    assert_image,
    cloud,
    pooled,
    run,
    ways,
)
from test_environment import radiance

FURNACES = {
    "lanes": {"tracker": "woodcock"},
    "lanes linear": {"tracker": "woodcock", "interpolation": "linear", "extinction": 0.3},
    "march": {"tracker": "march"},
    "march linear": {"tracker": "march", "interpolation": "linear"},
    "scalar": {"simd": "scalar", "tracker": "woodcock"},
    "scalar linear": {"simd": "scalar", "interpolation": "linear"},
    "rgb": {"extinction": (0.3, 1.0, 4.0), "tracker": "woodcock"},
    "rgb thin": {"extinction": (0.05, 0.1, 0.4), "tracker": "woodcock"},
    "rgb march": {"extinction": (0.3, 1.0, 4.0), "tracker": "march"},
    "rgb albedo": {"albedo": (1.0, 1.0, 1.0), "extinction": 2.0},
    "homogeneous": {"volume": np.ones(SHAPE, np.float32)},
    "inside": {"view": INSIDE},
    "box": {"volume": mcrt.Medium.box(SIZE, albedo=1.0, phase=mcrt.HenyeyGreenstein(0.9))},
    "sphere": {
        "volume": mcrt.Medium.sphere(
            1.5, center=(2.8, 1.8, 2.7), albedo=1.0, phase=mcrt.HenyeyGreenstein(0.9)
        )
    },
    "rgb sphere": {
        "volume": mcrt.Medium.sphere(
            1.5, center=(2.8, 1.8, 2.7), albedo=1.0, extinction=(0.2, 1, 4)
        )
    },
}


def furnace(name, monkeypatch, **options):
    base = {"volume": cloud(), "spacing": SPACING, "interpolation": "nearest", "albedo": 1.0}
    base |= {"phase": mcrt.HenyeyGreenstein(0.9), "spp": 4000, "extinction": 1.0} | FURNACES[name]
    monkeypatch.setenv("MCRT_SIMD", base.pop("simd", ""))
    base["camera"] = base.pop("view", VIEW).camera()
    base |= options
    volume = base.pop("volume")
    if isinstance(volume, mcrt.Medium):
        for what in ("spacing", "interpolation", "albedo", "phase", "extinction"):
            base.pop(what)
    return run(volume, **base)


@pytest.mark.parametrize("sky", ["constant", "map"])
@pytest.mark.parametrize("name", ways(FURNACES))
def test_white_furnace_is_white(name, sky, monkeypatch):
    """Without absorption under a uniform sky every pixel has the sky's radiance."""
    light = mcrt.EnvironmentLight(1.0 if sky == "constant" else ALMOST)
    result = furnace(name, monkeypatch, light=light)
    background = result.image(order=0)
    np.testing.assert_allclose(background, 1 - result.alpha(), rtol=0, atol=5e-7)
    image, error = result.image(), result.image_error()
    assert_image((image + background, error), 1.0, what=name)
    assert error.max() < 0.03


def test_a_map_and_what_it_lacks_make_a_constant(monkeypatch):
    """Light from a map with a sun and dark texels, sharply scattered: both ways to find it."""
    rng = np.random.default_rng(6)
    part = np.where(rng.random((8, 12, 1)) < 0.5, 0, rng.random((8, 12, 3)))
    part[2, 3] = 20
    rest = part.max() - part
    for name in ("lanes", "scalar linear", "march", "sphere", "inside"):
        runs = [
            furnace(
                name,
                monkeypatch,
                light=mcrt.EnvironmentLight(sky),
                phase=mcrt.HenyeyGreenstein(0.8),
                spp=8000,
                seed=seed,
            )
            for seed, sky in enumerate((part, rest))
        ]
        image, error = pooled(*runs)
        image = image + sum(r.image(order=0) for r in runs)
        assert_image((image / 20, error / 20), 1.0, what=name, largest=0.004)


@pytest.mark.parametrize("simd", SIMDS)
def test_one_bright_texel_is_a_directional_light(simd, monkeypatch):
    monkeypatch.setenv("MCRT_SIMD", simd)
    texels = np.zeros((64, 128, 3), np.float32)
    texels[20, 90] = 1000.0, 500.0, 100.0
    # Its bilinear tent, from nodes of a midpoint rule around it.
    step = np.pi / 64
    row, column = (np.indices((120, 120)) + 0.5) / 60 - 1
    polar, azimuth = (20.5 + row) * step, (90.5 + column - 64) * step
    s = np.sin(polar)
    d = np.stack([s * np.sin(azimuth), s * np.cos(azimuth), np.cos(polar)], -1)
    sent = radiance(texels, d) * s[..., None] * (step / 60) ** 2
    flux = sent.sum((0, 1))
    middle = (sent[..., :1] * d).sum((0, 1))
    common = {
        "spacing": SPACING,
        "extinction": 1.0,
        "albedo": (0.9, 0.7, 0.9),
        "phase": mcrt.HenyeyGreenstein(0.4),
        "camera": VIEW.camera(),
    }
    a = run(cloud(), light=mcrt.EnvironmentLight(texels), spp=12_000, **common)
    b = run(cloud(), light=mcrt.DirectionalLight(-middle, flux), spp=12_000, seed=1, **common)
    # The texel is 3 degrees wide: what is linear in the angle averages out, curvature does not.
    assert_image(a, b.image(), b.image_error(), relative=1e-3, largest=0.01)


def test_a_map_lights_as_its_texels_do(monkeypatch):
    """Two maps together are their sum."""
    rng = np.random.default_rng(9)
    one, two = (rng.gamma(0.3, 1.0, (6, 10)) for _ in range(2))
    runs = [
        furnace(
            "lanes",
            monkeypatch,
            albedo=0.7,
            light=[mcrt.EnvironmentLight(sky) for sky in skies],
            seed=seed,
            spp=8000,
        )
        for seed, skies in enumerate(((one, two), (one + two,)))
    ]
    assert_image(runs[0], runs[1].image(), runs[1].image_error(), largest=0.02)


EMITTERS = [
    "lanes",
    "march linear",
    "scalar",
    "rgb",
    "rgb thin",
    "rgb march",
    "homogeneous",
    "inside",
]


@pytest.mark.parametrize("sky", ["constant", "map"])
@pytest.mark.parametrize("name", ways(EMITTERS))
def test_a_medium_as_hot_as_its_surroundings_is_not_seen(name, sky, monkeypatch):
    albedo = 0.7
    medium = FURNACES[name]
    density = medium.get("volume", cloud()).astype(float)
    sigma = np.multiply.outer(density, medium.get("extinction", 1.0))
    result = furnace(
        name,
        monkeypatch,
        albedo=albedo,
        emission=(1 - albedo) * sigma,
        light=mcrt.EnvironmentLight(1.0 if sky == "constant" else ALMOST),
        spp=10_000,
    )
    image = result.image() + result.image(order=0)
    assert_image((image, result.image_error()), 1.0, what=name)
    assert result.image_error().max() < 0.02


@pytest.mark.parametrize("name", ["box", "sphere", "rgb sphere"])
def test_a_solid_as_hot_as_its_surroundings_is_not_seen(name):
    sigma = np.array([0.2, 1.0, 4.0]) if name == "rgb sphere" else np.array(1.5)
    options = {"albedo": 0.8, "extinction": sigma, "emission": 0.2 * sigma}
    solid = (
        mcrt.Medium.box(SIZE, **options)
        if name == "box"
        else mcrt.Medium.sphere(1.5, center=(2.8, 1.8, 2.7), **options)
    )
    result = run(solid, light=mcrt.EnvironmentLight(1.0), camera=VIEW.camera(), spp=20_000)
    image = result.image() + result.image(order=0)
    assert_image((image, result.image_error()), 1.0, what=name)


@pytest.mark.parametrize("extinction", [1.0, (0.2, 1.0, 4.0)], ids=["grey", "rgb"])
def test_emission_without_scattering_is_integrated(extinction):
    emission = np.random.default_rng(2).random((*SHAPE, 3))
    common = {"spacing": SPACING, "extinction": extinction, "albedo": 0.0, "emission": emission}
    common |= {"camera": VIEW.camera(), "light": (), "progress": False}
    path = mcrt.simulate(cloud(), method="path", spp=8, **common)
    single = mcrt.simulate(cloud(), method="single", **common)
    np.testing.assert_array_equal(path.image(), single.image())
    np.testing.assert_array_equal(path.image(order="emission"), path.image())
    assert np.all(path.image_error() == 0)
    assert path.image().min() > 0
