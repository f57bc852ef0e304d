"""Emission: what a medium that shines sends to the eye, into itself and out.

Truths: the line integral of source term times transmittance by float64 quadrature; equilibrium: in
an environment of radiance B a medium with L_e = sigma_a B holds the radiance B everywhere, in every
direction. False alarms: 1e-5 per assertion (Bonferroni over voxels, pixels and channels), about 60
assertions.
"""

import itertools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import gappy
from scipy import stats

SHAPE, SPACING = (4, 5, 6), (1.1, 0.6, 0.8)
SIZE = np.multiply(SHAPE, SPACING)[::-1]
VIEW = truth.View((-6, -9, 8), (2.4, 1.5, 2.2), (12, 10), fov=40)
INSIDE = truth.View((1.3, 0.9, 2.2), (3.9, 2.0, 1.1), (8, 6), fov=70)


def cloud(seed=41):
    return gappy(SHAPE, seed)


def run(density, **arguments):
    defaults = {
        "spacing": SPACING,
        "camera": VIEW.camera(),
        "method": "photon",
        "photons": 2e5,
        "progress": False,
    }
    return mcrt.simulate(density, **(defaults | arguments))


# ---------------------------------------------------------------- the emission-absorption integral


def line_integrals(density, emission, extinctions, origin, direction, linear):
    """The integrals of emission * exp(-extinction * column) along one ray, of each channel: two
    Gauss nodes in pieces that are fine towards the front of each cell, since opaque cells shine
    from there. Twice as many pieces change 1e-7 of it."""
    near, far = truth.box_interval(origin, direction, SIZE)
    totals = np.zeros(len(extinctions))
    if far <= near:
        return totals
    cuts = [near, far]
    for axis in range(3):
        n, h = SHAPE[2 - axis], SPACING[2 - axis]
        planes = (np.arange(n) + 0.5) * h if linear else np.arange(1, n) * h
        cuts += list((planes - origin[axis]) / direction[axis])
    cuts = np.unique(np.clip(cuts, near, far))
    grid = np.union1d(np.geomspace(1e-9, 1, 300), np.linspace(0, 1, 100))
    t = np.concatenate([a + grid[:-1] * (b - a) for a, b in itertools.pairwise(cuts)] + [[far]])
    start, step = t[:-1], np.diff(t)

    def at(field, part):
        place = origin + (start + part * step)[:, None] * direction
        return truth.density_at(field, SPACING, place, linear)

    nodes = (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12))
    whole = sum(at(density, x) for x in nodes) / 2 * step
    before = np.cumsum(whole) - whole
    for x in nodes:
        column = before + x * step * at(density, x / 2)
        shine = [step / 2 * at(field, x) for field in np.moveaxis(emission, -1, 0)]
        for c, extinction in enumerate(extinctions):
            totals[c] += (shine[c % len(shine)] * np.exp(-extinction * column)).sum()
    return totals


def pixels():
    """Cameras of one pixel, so narrow that it is a ray: from outside, from inside."""
    rng = np.random.default_rng(6)
    for i in range(16):
        target = rng.random(3) * SIZE
        eye = rng.random(3) * SIZE if i % 4 == 0 else target + rng.normal(size=3) * 20
        yield truth.View(tuple(eye), tuple(target), (1, 1), fov=1e-4)


FIELDS = {
    "cloud": lambda: cloud(),
    "thick": lambda: 60 * cloud(),
    "opaque": lambda: 1e4 * cloud(),
    "void": lambda: np.zeros(SHAPE, np.float32),
    "constant": lambda: np.full(SHAPE, 0.7, np.float32),
}


@pytest.mark.parametrize("extinction", [0.5, (0.02, 0.5, 3.0)], ids=["grey", "rgb"])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("field", FIELDS)
def test_the_image_is_the_line_integral(field, interpolation, channels, extinction):
    density, linear = FIELDS[field](), interpolation == "linear"
    emission = np.random.default_rng(3).gamma(0.5, 1.0, (*SHAPE, channels))
    emission[:2] *= density[:2, ..., None] == 0  # here the medium shines in voids alone
    emission = emission.astype(np.float32)
    result = run(
        density,
        interpolation=interpolation,
        extinction=extinction,
        albedo=0.0,
        emission=emission[..., 0] if channels == 1 else emission,
        outputs=("image",),
        photons=64,
    )
    sigma = np.broadcast_to(extinction, 3)[: 3 if np.size(extinction) + channels > 2 else 1]
    for view in pixels():
        origin, direction, _ = (np.squeeze(x) for x in view.rays())
        image = np.broadcast_to(result.image(view.camera())[0, 0], 3)
        expected = line_integrals(density, emission, sigma, origin, direction, linear)
        np.testing.assert_allclose(image[: len(expected)], expected, rtol=1e-5, atol=1e-9)
        layer = result.image(view.camera(), order="emission")
        assert np.array_equal(layer, result.image(view.camera()))


def test_empty_blocks_are_not_passed_over():
    # blocks of 8^3 voxels: the density is in one corner, the emission in another
    density, emission = np.zeros((2, 24, 24, 24), np.float32)
    density[:4, :4, :4] = 1
    emission[20:, 20:, 20:] = 2.0
    for interpolation in ("nearest", "linear"):
        result = run(
            density,
            spacing=1.0,
            emission=emission,
            interpolation=interpolation,
            camera=mcrt.OrthographicCamera(
                (22, 22, 50), (22, 22, 0), width=1e-3, resolution=(1, 1)
            ),
            photons=64,
        )
        expected = 8.0 if interpolation == "nearest" else 2 * (3.5 + 0.5)
        np.testing.assert_allclose(result.image(), expected, rtol=1e-6)


def test_smooth_clouds_in_even_steps_keep_the_exact_emission():
    z, y, x = np.indices((20, 20, 20)) - 9.5
    density = np.clip(1.2 - (x * x + y * y + z * z) / 60, 0, 1).astype(np.float32)
    view = truth.View((30, 25, 20), (10, 10, 10), (10, 8), fov=35)
    box = {"spacing": 1.0, "extinction": 0.2, "camera": view.camera(), "albedo": 0.0}
    result = run(density, emission=0.2 * density, photons=64, **box)
    # With L_e = sigma_a the integral is 1 - transmittance. Few rays a pixel, whose alpha goes in
    # even steps.
    true = 1 - truth.transmittance_image(view, 0.2 * density.astype(float), (1, 1, 1), True, sub=6)
    np.testing.assert_allclose(result.image(), true, rtol=0, atol=3e-4)
    np.testing.assert_allclose(result.alpha(), true, rtol=0, atol=1e-3)


# ------------------------------------------------------------------------------------- equilibrium

MEDIA = {
    "nearest": {"interpolation": "nearest", "tracker": "woodcock"},
    "linear": {"interpolation": "linear", "tracker": "woodcock"},
    "march": {"interpolation": "linear", "tracker": "march"},
}
COLOURS = {
    "black": (1.3, 0.0, 0.8),
    "grey": (1.3, 0.6, 0.8),
    "rgb albedo": (1.3, (0.2, 0.6, 0.95), (0.5, 0.8, 1.5)),
    "rgb extinction": ((0.4, 1.3, 4.0), 0.6, (0.5, 0.8, 1.5)),
}


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("medium", MEDIA)
def test_equilibrium_is_uniform(medium, colour):
    extinction, albedo, radiance = (np.array(v) for v in COLOURS[colour])
    density = cloud()
    shine = extinction * (1 - albedo) * radiance
    result = run(
        density,
        extinction=extinction,
        albedo=albedo,
        emission=density[..., None] * shine if shine.ndim else density * shine,
        light=mcrt.EnvironmentLight(radiance),
        phase=mcrt.HenyeyGreenstein(0.4),
        photons=4e5,
        seed=11,
        **MEDIA[medium],
    )
    error, dof = result.fluence_error, comparing.dof(result)
    comparing.assert_z(result.fluence, 4 * np.pi * radiance, error, dof=dof, what="fluence")
    assert np.median(error / (4 * np.pi * radiance)) < 0.028
    comparing.assert_z(
        result.radiance, albedo * radiance, result.radiance_error, dof=dof, what="radiance"
    )
    image, error = result.image() + result.image(order=0), result.image_error()
    dof = comparing.dof(result, "pixel")
    comparing.assert_z(image, radiance, error, dof=dof, what="image")
    comparing.assert_balance(result.energy)


def test_equilibrium_is_uniform_in_spherical_harmonics_and_for_an_eye_inside():
    density = cloud()
    result = run(
        density,
        albedo=0.7,
        emission=0.3 * density,
        light=mcrt.EnvironmentLight(1.0),
        phase=mcrt.Rayleigh(),
        angular="sh",
        photons=6e5,
    )
    for view in (VIEW, INSIDE):
        image = result.image(view.camera()) + result.image(view.camera(), order=0)
        error, dof = result.image_error(view.camera()), comparing.dof(result, "pixel")
        comparing.assert_z(image, 1, error, dof=dof, what="image")


def test_equilibrium_with_an_albedo_per_voxel():
    density = cloud()
    albedo = np.random.default_rng(2).random(SHAPE).astype(np.float32)
    result = run(
        density,
        interpolation="nearest",
        extinction=2.0,
        albedo=albedo,
        emission=2 * density * (1 - albedo),
        light=mcrt.EnvironmentLight(1.0),
        photons=6e5,
    )
    error, dof = result.fluence_error, comparing.dof(result)
    comparing.assert_z(result.fluence, 4 * np.pi, error, dof=dof)


# ------------------------------------------------------------------------------- power and fluence


def test_all_that_a_white_medium_emits_leaves_it():
    result = run(np.ones(SHAPE), extinction=2.0, albedo=1.0, emission=0.3)
    energy = result.energy
    assert energy.launched == pytest.approx(4 * np.pi * 0.3 * np.prod(SIZE), rel=1e-7)
    assert energy.absorbed == 0
    left = energy.unscattered + sum(energy.escaped.values()) + energy.roulette
    assert left == pytest.approx(1, abs=1e-6)
    assert energy.sum() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_launched_is_the_volume_integral_of_any_emission(interpolation):
    emission = np.random.default_rng(3).gamma(0.5, 1.0, (*SHAPE, 3)).astype(np.float32)
    result = run(
        cloud(), extinction=(1, 2, 3), emission=emission, interpolation=interpolation, photons=2e4
    )
    expected = 4 * np.pi * emission.sum((0, 1, 2), dtype=float) * np.prod(SPACING)
    np.testing.assert_allclose(result.energy.launched, expected, rtol=1e-6)
    comparing.assert_balance(result.energy)


def test_deep_in_a_thick_absorber_fluence_is_emission_over_absorption():
    result = run(
        np.ones((9, 9, 9)), spacing=1.0, extinction=8.0, albedo=0.5, emission=0.6, photons=4e5
    )
    middle = (slice(3, 6),) * 3
    expected = 4 * np.pi * 0.6 / (8.0 * 0.5)
    error, dof = result.fluence_error[middle], comparing.dof(result)
    comparing.assert_z(result.fluence[middle], expected, error, dof=dof)


def test_a_shining_void_is_as_bright_as_it_is_long():
    result = run(np.zeros(SHAPE), emission=0.7, photons=2e5)
    origin, direction, weight = VIEW.rays(8)
    near, far = truth.box_interval(origin, direction, SIZE)
    expected = 0.7 * (np.clip(far - near, 0, None) * weight).sum(-1)
    # Of an edge's pixel few rays tell how much is covered: 1 % of the longest way.
    np.testing.assert_allclose(result.image(), expected, rtol=0, atol=0.02)
    assert comparing.relative_rms(result.image(), expected) < 0.0075
    assert result.energy.unscattered == pytest.approx(1, abs=1e-6)


# ------------------------------------------------------------------------------ layers and methods


def test_the_image_is_the_sum_of_its_layers():
    light = mcrt.PointLight((9, -7, 12), 50.0)
    result = run(cloud(), emission=0.5, light=light)
    layers = [result.image(order=order) for order in (1, "2+", "emission")]
    np.testing.assert_allclose(result.image(), sum(layers), rtol=1e-6)
    assert min(layer.max() for layer in layers) > 0
    assert np.all(result.image(order=0) == 0)


def test_lights_and_emission_add_up():
    light = mcrt.PointLight((9, -7, 12), 50.0)
    both = run(cloud(), emission=0.5, light=light)
    one, two = run(cloud(), emission=0.5, seed=1), run(cloud(), light=light, seed=2)
    error = np.hypot(one.fluence_error, two.fluence_error)
    total = one.fluence + two.fluence
    comparing.assert_z(both.fluence, total, both.fluence_error, error, dof=comparing.dof(one))
    error = np.hypot(one.image_error(), two.image_error())
    total = one.image() + two.image()
    comparing.assert_z(both.image(), total, both.image_error(), error, dof=15)


@pytest.mark.cpu_only("many short runs; test_gpu.py holds the GPU's pictures against the CPU's")
def test_single_is_emitted_light_and_light_scattered_once():
    arguments = {"emission": 0.5, "phase": mcrt.HenyeyGreenstein(0.3)}
    single, photon = run(cloud(), method="single", **arguments), run(cloud(), seed=1, **arguments)
    assert np.array_equal(single.image(order="emission"), photon.image(order="emission"))
    np.testing.assert_allclose(
        single.image(), single.image(order=1) + single.image(order="emission"), rtol=1e-6
    )
    # Over seeds, for the error of a picture is that of all its orders together.
    few = {"photons": 2e4, "outputs": ("image",)} | arguments
    one = [run(cloud(), method="single", seed=s, **few).image(order=1) for s in range(24)]
    two = [run(cloud(), seed=100 + s, **few).image(order=1) for s in range(24)]
    errors = stats.sem(one), stats.sem(two)
    comparing.assert_z(np.mean(one, 0), np.mean(two, 0), *errors, dof=23)
    comparing.assert_mean(np.sum(one, (1, 2)) / np.sum(two, (1, 2)), 1.0)
    more = run(cloud(), seed=2, max_scatterings=1, **arguments)
    error = np.hypot(single.image_error(), more.image_error())
    comparing.assert_z(single.image(), more.image(), error, dof=15)


def test_without_scatterings_emission_is_seen_and_nothing_else():
    light = mcrt.PointLight((9, -7, 12), 50.0)
    result = run(cloud(), emission=0.5, light=light, max_scatterings=0, photons=1000)
    assert np.array_equal(result.image(), result.image(order="emission"))
    assert result.image().max() > 0


def test_an_emitting_medium_has_no_default_light():
    result = run(cloud(), emission=0.5)
    assert result.energy.launched == pytest.approx(2 * np.pi * np.prod(SIZE), rel=1e-6)
    plan = str(mcrt.plan(cloud(), emission=0.5))
    assert "PointLight" not in plan
    assert "grey: photons start in the medium" in plan
    assert "PointLight" in str(mcrt.plan(cloud()))


@pytest.mark.parametrize("method", ["auto", "single", "photon"])
@pytest.mark.parametrize(
    "dark",
    [
        {"light": ()},
        {"light": []},
        {"emission": 0.0},
        {"emission": (0, 0, 0), "light": ()},
        {"emission": np.zeros(SHAPE)},
        {"light": [mcrt.PointLight((0, 0, 9), 0.0), mcrt.EnvironmentLight(0.0)]},
    ],
    ids=["tuple", "list", "number", "rgb", "array", "lights"],
)
def test_without_power_all_is_dark(dark, method):
    for target in ({"photons": 1000}, {"photons": None, "target_error": 0.1}):
        result = run(cloud(), method=method, **dark, **target)
        for values in (result.image(), result.fluence, result.radiance, result.absorbed):
            assert np.all(values == 0)
        assert np.all(result.image_error() == 0)
        assert np.all(result.energy.launched == 0)
        assert np.all(result.energy.sum() == 0)
        assert str(result)


def test_the_target_error_counts_emission_as_signal():
    result = run(cloud(), emission=0.5, photons=None, target_error=0.01)
    assert result.stats.stopped_by == "target_error"
    assert result.stats.relative_error <= 0.01


# ------------------------------------------------------------------------------ files and the rest


@pytest.mark.parametrize("channels", [1, 3])
def test_results_are_saved_and_merged(tmp_path, channels):
    emission = np.random.default_rng(3).random((*SHAPE, channels))
    emission = emission[..., 0] if channels == 1 else emission
    a, b = (run(cloud(), emission=emission, photons=2e4, seed=seed) for seed in range(2))
    merged = a + b
    merged.save(tmp_path / "glow.npz")
    loaded = mcrt.Result.load(tmp_path / "glow.npz")
    assert np.array_equal(loaded.image(INSIDE.camera()), merged.image(INSIDE.camera()))
    assert np.array_equal(loaded.image(order="emission"), a.image(order="emission"))
    assert np.array_equal(loaded.to_xarray()["image"], merged.image())
    with pytest.raises(mcrt.SceneError, match="emission differs"):
        a + run(cloud(), emission=2 * emission, photons=2e4, seed=2)


@pytest.mark.cpu_only("a file of what other tests see")
def test_exr_holds_the_emission(tmp_path):
    exr = pytest.importorskip("OpenEXR")
    result = run(cloud(), emission=0.5, photons=1000)
    result.save_exr(tmp_path / "glow.exr")
    with exr.File(str(tmp_path / "glow.exr"), separate_channels=True) as file:
        stored = file.channels()["emission.R"].pixels
    np.testing.assert_allclose(stored, result.image(order="emission"), rtol=1e-6)


def test_a_medium_holds_its_emission():
    emission = np.ones((*SHAPE, 3))
    medium = mcrt.Medium(cloud(), spacing=SPACING, emission=emission)
    emission[:] = 0
    assert medium.emission.shape == (*SHAPE, 3)
    assert medium.emission.max() == 1
    result = mcrt.simulate(medium, photons=1000, method="photon", progress=False)
    assert result.energy.launched.shape == (3,)
    with pytest.raises(mcrt.SceneError, match="emission given both"):
        mcrt.simulate(medium, emission=1.0)


def test_the_threads_do_not_matter():
    for emission in (0.5, (0.1, 0.5, 0.9)):
        one, two = (run(cloud(), emission=emission, photons=2e4, threads=n) for n in (1, 2))
        assert np.array_equal(one.fluence, two.fluence)
        assert np.array_equal(one.image(), two.image())
