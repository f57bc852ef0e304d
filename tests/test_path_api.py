"""Paths from the camera: determinism, merging, files, stopping, edge cases and bad input.

False alarms: 1e-5 per assertion that compares samples, about 10 of them.
"""

import closed_forms
import comparing
import mcrt
import numpy as np
import pytest
from conftest import (
    CENTRE,
    ORIGIN,
    SHAPE,
    SPACING,
    camera,
    density,
    interrupted,
    processor_seconds,
)
from path_cases import BEYOND, SIMDS, need

LIGHT = mcrt.PointLight((30.0, -40.0, 50.0), 1e3)
LAMP = mcrt.PointLight(CENTRE, 10.0)
SKY = np.random.default_rng(4).random((4, 8, 3))


def run(volume=None, **arguments):
    defaults = {
        "extinction": 0.8,
        "light": LIGHT,
        "camera": camera(),
        "spp": 64,
        "method": "path",
        "progress": False,
    }
    if not isinstance(volume, mcrt.Medium):
        defaults |= {"spacing": SPACING, "origin": ORIGIN}
    else:
        del defaults["extinction"]
    return mcrt.simulate(density() if volume is None else volume, **(defaults | arguments))


def same(a, b):
    return np.array_equal(a.image(), b.image()) and all(
        np.array_equal(x, y)
        for x, y in (
            (a.image(order=1), b.image(order=1)),
            (a.image(order="2+"), b.image(order="2+")),
            (a.image_error(), b.image_error()),
        )
    )


# ------------------------------------------------------------------------------------- determinism

SCENES = {
    "linear": {},
    "nearest": {"interpolation": "nearest", "phase": mcrt.HenyeyGreenstein(0.5)},
    "opaque": {"extinction": 20.0},
    "inside": {"light": LAMP},
    "map": {"light": mcrt.EnvironmentLight(SKY), "phase": mcrt.Rayleigh()},
    "rgb": {"extinction": (0.2, 1.0, 4.0)},
    "emission": {"emission": density(3), "light": ()},
    "march": {"tracker": "march"},
    "box": {
        "volume": mcrt.Medium.box((3, 5, 6), origin=ORIGIN),
        "light": [LIGHT, LAMP, mcrt.EnvironmentLight(SKY)],
    },
    "sphere": {"volume": mcrt.Medium.sphere(2, center=CENTRE)},
}


@pytest.mark.parametrize("name", SCENES)
def test_the_same_seed_gives_the_same_bits_on_any_number_of_threads(name):
    runs = [run(seed=7, threads=threads, **SCENES[name]) for threads in (1, 2, 3, None)]
    assert all(same(runs[0], other) for other in runs[1:])
    assert not same(runs[0], run(seed=8, **SCENES[name]))
    assert np.isfinite(runs[0].image()).all()
    assert runs[0].image().max() > 0


@pytest.mark.cpu_only("instruction sets are the CPU's")
@pytest.mark.parametrize("simd", BEYOND)
@pytest.mark.parametrize("name", SCENES)
def test_every_instruction_set_gives_the_same_bits(name, simd, monkeypatch):
    need(simd)
    runs = []
    for which in ("baseline", simd):
        monkeypatch.setenv("MCRT_SIMD", which)
        runs.append(run(seed=3, **SCENES[name]))
    assert same(*runs)


def test_more_samples_go_on_where_fewer_ended():
    """Under a goal the run is cut into other passes, but it is that of the samples that it took, up
    to the rounding of sums (in a homogeneous medium, whose lights are found in the same way however
    many samples there are)."""
    volume = np.ones(SHAPE)
    goal = run(volume, spp=None, target_error=0.05, seed=5)
    given = run(volume, spp=goal.stats.spp, seed=5)
    np.testing.assert_allclose(goal.image(), given.image(), rtol=1e-6)
    np.testing.assert_allclose(goal.image_error(), given.image_error(), rtol=1e-6)


# ---------------------------------------------------------------------------------- samples, merges


@pytest.mark.parametrize(
    ("spp", "taken"), [(1, 1), (2, 2), (3, 3), (5, 6), (8, 8), (9, 12), (1e2, 100)]
)
def test_samples_are_rounded_up_to_whole_view_rays(spp, taken):
    result = run(spp=spp)
    assert result.stats.spp == taken
    assert result.stats.photons == taken * 14 * 10
    assert result.stats.stopped_by == "spp"
    image, error = result.image(), result.image_error()
    assert np.isfinite(image).all()
    assert not np.isnan(error).any()
    if spp == 1:  # no variance of one sample
        assert np.all(np.isinf(error[image > 0]))
    else:
        assert np.isfinite(error).all()


def test_few_samples_are_unbiased():
    """A view ray with one path, two, three: the mean of many runs is that of a long one."""
    reference = run(spp=40_000, seed=10**6, max_scatterings=3)
    for spp in (1, 2, 3, 5):
        runs = [run(spp=spp, seed=seed, max_scatterings=3).image().mean() for seed in range(40)]
        error = np.hypot(
            np.std(runs, ddof=1) / np.sqrt(len(runs)),
            np.sqrt(np.sum(reference.image_error().astype(float) ** 2)) / 140,
        )
        comparing.assert_z(
            np.mean(runs), reference.image().mean(), error, dof=len(runs) - 1, what=f"spp {spp}"
        )


def test_merged_runs_weigh_by_their_samples():
    a, b = run(spp=100, seed=1), run(spp=300, seed=2)
    merged = a + b
    assert merged.stats.photons == a.stats.photons + b.stats.photons
    for order in (None, 1, "2+"):
        expected = (a.image(order=order) + 3 * b.image(order=order)) / 4
        np.testing.assert_allclose(merged.image(order=order), expected, rtol=1e-5, atol=1e-9)
    error = np.hypot(a.image_error(), 3 * b.image_error()) / 4
    np.testing.assert_allclose(merged.image_error(), error, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(merged.alpha(), a.alpha())
    reference = run(spp=4000, seed=3)
    comparing.assert_z(
        merged.image(), reference.image(), merged.image_error(), reference.image_error()
    )
    with pytest.raises(mcrt.SceneError, match="same seed"):
        a + run(spp=50, seed=1)
    with pytest.raises(mcrt.SceneError, match="method"):
        a + mcrt.simulate(
            density(),
            spacing=SPACING,
            origin=ORIGIN,
            extinction=0.8,
            light=LIGHT,
            camera=camera(),
            photons=1000,
            outputs=("image",),
            method="photon",
            progress=False,
            seed=9,
        )


def test_merged_runs_count_their_samples():
    merged = run(spp=100, seed=1) + run(spp=300, seed=2)
    assert merged.stats.spp == 400
    nu = 400**2 / (100**2 / 24 + 300**2 / 74)  # 24 and 74 of the runs: 25 and 75 view rays
    assert merged.stats.degrees_of_freedom_pixel == pytest.approx(nu)


@pytest.mark.parametrize("name", ["linear", "map", "emission", "box", "sphere"])
def test_results_are_saved_and_loaded(name, tmp_path):
    result = run(**SCENES[name])
    result.save(tmp_path / "path.npz")
    loaded = mcrt.Result.load(tmp_path / "path.npz")
    assert same(result, loaded)
    for layer in (result, loaded):
        np.testing.assert_array_equal(layer.alpha(), result.alpha())
        np.testing.assert_array_equal(layer.image(order=0), result.image(order=0))
        np.testing.assert_array_equal(layer.image(order="emission"), result.image(order="emission"))
    assert loaded.stats.spp == result.stats.spp
    assert "path" in repr(loaded)
    assert str(loaded)
    assert "<img" in loaded._repr_html_()
    assert np.isfinite((loaded + run(seed=1, **SCENES[name])).image()).all()


def test_layers_add_up():
    result = run(emission=density(3), light=[LIGHT, mcrt.EnvironmentLight(0.5)])
    parts = [result.image(order=order) for order in (1, "2+", "emission")]
    np.testing.assert_allclose(result.image(), sum(parts), rtol=1e-6)
    assert all(part.max() > 0 for part in parts)
    np.testing.assert_allclose(result.image(order=0), 0.5 * (1 - result.alpha()), rtol=1e-5)


# -------------------------------------------------------------------------------------- stopping


def test_target_error_is_reached_and_honest():
    reference = run(spp=40_000, seed=10**6, backend="cpu")
    true = reference.image()
    bright = true > 0.05 * true.max()
    ratios = []
    for seed in range(8):
        result = run(spp=None, target_error=0.03, seed=seed)
        assert result.stats.stopped_by == "target_error"
        assert result.stats.relative_error <= 0.03
        assert result.stats.relative_error > 0.01  # and not by far
        difference = (result.image() - true)[bright].astype(float)
        ratios.append(np.mean(difference**2) / np.mean(true[bright]) ** 2)
    # The mean over 8 runs of some 80 independent pixels each: known within 15 % (5 sigma: 30 %).
    assert 0.5 * 0.03 < np.sqrt(np.mean(ratios)) < 1.2 * 0.03


def test_a_run_to_an_error_has_the_bits_of_its_samples():
    result = run(spp=None, target_error=0.03)
    np.testing.assert_array_equal(run(spp=result.stats.spp).image(), result.image())


def test_no_budget_is_two_percent():
    result = run(spp=None)
    assert result.stats.stopped_by == "target_error"
    assert result.stats.relative_error <= 0.02


def test_samples_imply_paths():
    assert run(method="auto").plan.method == "path"
    assert same(run(method="auto"), run())


def test_time_limit_stops_the_run():
    start = processor_seconds()
    result = run(spp=None, time_limit=0.3)
    # Kernels that are compiled first are not counted in the limit.
    assert processor_seconds() - start < 3.0
    assert result.stats.stopped_by == "time_limit"
    assert result.stats.spp >= 8
    assert np.isfinite(result.image_error()).all()
    reference = run(spp=4000, seed=1)
    comparing.assert_z(
        result.image(), reference.image(), result.image_error(), reference.image_error()
    )
    many = run(spp=1e9, time_limit=0.2)
    assert many.stats.stopped_by == "time_limit"


def test_a_hopeless_time_limit_still_gives_error_bars():
    result = run(spp=None, time_limit=1e-9)
    assert result.stats.stopped_by == "time_limit"
    assert result.stats.spp >= 8
    assert np.isfinite(result.image_error()).all()


def test_progress_is_reported_and_rises():
    seen = []
    run(spp=20_000, progress=lambda fraction, info: seen.append(fraction))
    assert all(0.0 <= fraction <= 1.0 for fraction in seen)
    assert seen == sorted(seen)


def test_progress_can_stop_the_run():
    result = run(spp=1e9, progress=lambda fraction, info: False)
    assert result.stats.stopped_by == "progress"
    assert result.stats.spp >= 8
    reference = run(spp=4000, seed=1)
    comparing.assert_z(
        result.image(),
        reference.image(),
        result.image_error(),
        reference.image_error(),
        dof=result.stats.degrees_of_freedom_pixel,
    )


def test_an_exception_in_progress_comes_out():
    def fail(fraction, info):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run(spp=1e9, progress=fail)


@pytest.mark.cpu_only("test_gpu_trouble.py interrupts the GPU")
@pytest.mark.parametrize(
    "options",
    [{}, {"albedo": 1.0, "extinction": 1e4}, {"emission": 1.0, "extinction": (1, 2, 3)}],
    ids=["lanes", "endless", "scalar"],
)
def test_ctrl_c_interrupts_within_a_fifth_of_a_second(options):
    assert interrupted(lambda: run(spp=1e9, **options), after=0.3) < 0.2


# ------------------------------------------------------------------------------------- edge cases


def assert_dark(result):
    shape = result.image().shape
    for array in (result.image(), result.image(order=1), result.image(order="2+")):
        np.testing.assert_array_equal(array, np.zeros(shape))
    np.testing.assert_array_equal(result.image_error(), np.zeros(shape))
    assert np.isfinite(result.alpha()).all()
    assert str(result)
    assert result._repr_html_()


@pytest.mark.parametrize("simd", SIMDS)
@pytest.mark.parametrize(
    "options",
    [
        {"light": ()},
        {"light": mcrt.PointLight((30, -40, 50), 0.0)},
        {"light": mcrt.PointLight(CENTRE, 0.0)},
        {"light": [mcrt.DirectionalLight((0, 0, -1), 0.0), mcrt.EnvironmentLight(0.0)]},
        {"light": mcrt.EnvironmentLight(np.zeros((4, 8)))},
        {"max_scatterings": 0},
        {"max_scatterings": 0, "light": mcrt.EnvironmentLight(SKY)},
        {"albedo": 0.0},
        {"extinction": 0.0},
        {"volume": np.zeros(SHAPE)},
        {"volume": np.zeros(SHAPE), "light": [LAMP, mcrt.EnvironmentLight(SKY)]},
        {"volume": np.zeros((1, 1, 1)), "light": LAMP},
        {"camera": mcrt.PerspectiveCamera((25, -5, 40), (40, 5, 60), resolution=(5, 4))},
    ],
    ids=str,
)
def test_nothing_to_see_is_black(options, simd, monkeypatch):
    monkeypatch.setenv("MCRT_SIMD", simd)
    for goal in ({"spp": 16}, {"spp": None, "target_error": 0.01}, {"spp": None}):
        assert_dark(run(**options | goal))


@pytest.mark.parametrize(
    "light", [LIGHT, LAMP, mcrt.EnvironmentLight(1.0)], ids=lambda x: type(x).__name__
)
def test_one_voxel_is_a_box(light):
    size = np.multiply(SHAPE, SPACING)[::-1]
    box = mcrt.Medium.box(size, origin=ORIGIN, extinction=0.8)
    one = run(np.ones((1, 1, 1)), spacing=size[::-1], light=light, spp=800)
    for volume in (box, np.ones(SHAPE)):
        other = run(volume, light=light, spp=800, seed=1)
        comparing.assert_z(one.image(), other.image(), one.image_error(), other.image_error())
        # Silhouettes cross pixels: alpha is the mean of some rays.
        assert abs(one.alpha() - other.alpha()).mean() < 5e-4 * one.alpha().mean()


def test_a_thin_medium_is_its_first_order():
    """tau 1e-6: order 1 is the density's integral, no weight is lost in rounding.

    .1 %: some 5e-4 of what is a hundred times thicker is attenuated.
    """
    thin = run(extinction=1e-6, spp=4000)
    thick = run(extinction=1e-4, spp=4000, seed=1)
    comparing.assert_z(
        thin.image() * 100,
        thick.image(),
        thin.image_error() * 100.0,
        thick.image_error(),
        relative=1e-3,
    )
    assert thin.image(order="2+").max() < 1e-5 * thin.image().max()
    assert thin.image().max() > 0


@pytest.mark.parametrize("simd", SIMDS)
def test_an_opaque_medium_is_a_half_space(simd, monkeypatch):
    """tau 1e4, isotropic: Chandrasekhar's radiance for normal light seen along the normal."""
    monkeypatch.setenv("MCRT_SIMD", simd)
    albedo = 0.5
    result = mcrt.simulate(
        mcrt.Medium.box((1e6, 1e6, 1e4), albedo=albedo),
        light=mcrt.DirectionalLight((0, 0, -1), 1.0),
        camera=mcrt.OrthographicCamera((5e5, 5e5, 2e4), (5e5, 5e5, 0), (0, 1, 0), 10, (4, 4)),
        spp=20_000,
        progress=False,
    )
    h = closed_forms.h_function(albedo, np.array([1.0]))[0]
    comparing.assert_z(result.image(), albedo / 4 / np.pi * h * h / 2, result.image_error())


def test_an_eye_on_the_light_is_finite():
    for seed in range(3):
        eye = mcrt.PerspectiveCamera(CENTRE, (25, -5, 40), resolution=(5, 4))
        result = run(light=LAMP, camera=eye, seed=seed)
        assert np.isfinite(result.image()).all()
        assert (result.image() >= 0).all()


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_a_light_on_a_voxel_centre_or_corner_is_finite(interpolation):
    for at in ((11.25, -17.5, 33.75), (11.5, -17.0, 33.0), ORIGIN):
        result = run(light=mcrt.PointLight(at, 10.0), interpolation=interpolation)
        assert np.isfinite(result.image()).all()
        assert result.image().max() > 0


def test_solids_take_the_arguments_of_media():
    solid = {"extinction": (0.2, 1.0, 3.0), "albedo": 0.8, "phase": mcrt.Rayleigh()}
    for medium in (mcrt.Medium.box(3, **solid), mcrt.Medium.sphere(3, **solid)):
        assert "homogeneous" in repr(medium)
        result = mcrt.simulate(
            medium,
            spp=16,
            camera=mcrt.PerspectiveCamera((9, 8, 7), (1, 1, 1), resolution=(8, 6)),
            progress=False,
        )
        assert result.image().shape == (6, 8, 3)
        assert result.plan.method == "path"
        assert result.image().max() > 0
    # A box counts as one voxel where voxels are asked for.
    photon = mcrt.simulate(
        mcrt.Medium.box(3),
        outputs=("fluence", "radiance"),
        photons=1e4,
        light=mcrt.EnvironmentLight(1.0),
        progress=False,
    )
    assert photon.fluence.shape == (1, 1, 1)
