"""The interface does what its documentation says."""

import inspect
import pydoc
import subprocess
import sys
import threading
import time

import mcrt
import numpy as np
import pytest
from conftest import (
    ORIGIN,
    SHAPE,
    SPACING,
    camera,
    density,
    interrupted,
    processor_seconds,
    run,
)

VOXELS = ("fluence", "radiance", "absorbed")
PHASES = [
    mcrt.Isotropic(),
    mcrt.Rayleigh(),
    mcrt.HenyeyGreenstein(0.6),
    mcrt.TabulatedPhase((-1.0, 0.0, 0.5, 1.0), (2.0, 1.0, 1.0, 5.0)),
]


def unaligned(values):
    packed = np.zeros(values.shape, dtype=[("pad", "u1"), ("value", values.dtype)])
    packed["value"] = values
    return packed["value"]


def frozen(values):
    values = values.copy()
    values.flags.writeable = False
    return values


LAYOUTS = {
    "fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "negative strides": lambda a: a[::-1, :, ::-1].copy()[::-1, :, ::-1],
    "big-endian": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "read-only": frozen,
    "unaligned": unaligned,
    "list": lambda a: a.tolist(),
    "memoryview": memoryview,
}


def test_everything_has_a_default():
    result = mcrt.simulate(np.ones((2, 3, 4)), photons=1000)
    for name in VOXELS:
        assert getattr(result, name).shape == (2, 3, 4)
        assert np.isfinite(getattr(result, name + "_error")).all()
    assert result.image().shape == (600, 600)


def test_plan_takes_the_arguments_of_simulate(grey):
    assert mcrt.plan(density(), photons=1000, tracker="march").tracker == "march"
    with pytest.raises(TypeError, match="surprise"):
        mcrt.plan(density(), surprise=1)


@pytest.mark.cpu_only("the plan is the same on all backends")
@pytest.mark.parametrize("make", [mcrt.PerspectiveCamera, mcrt.OrthographicCamera])
@pytest.mark.parametrize(
    ("view", "up", "taken"), [((0, 0, -1), (0, 0, 1), "x"), ((2, 0, 0), (-1, 0, 0), "y")]
)
def test_the_plan_names_the_up_that_a_view_along_up_takes(make, view, up, taken):
    eye = np.array([0.0, 0.0, 50.0])
    along = make(eye, eye + view, up=up)
    rows = {
        name: (choice, reason)
        for name, choice, reason in mcrt.plan(density(), camera=along).decisions
    }
    assert rows["camera"][0] == f"up is +{taken}"
    assert "along the up" in rows["camera"][1]
    other = make(eye, eye + view, up=np.eye(3)["xyz".index(taken)])
    np.testing.assert_array_equal(*(run(camera=c).image() for c in (along, other)))
    assert all(name != "camera" for name, _, _ in mcrt.plan(density(), camera=other).decisions)


@pytest.mark.cpu_only("no result of a simulation")
def test_plan_and_simulate_have_one_signature_that_can_be_read():
    signatures = [inspect.signature(call) for call in (mcrt.plan, mcrt.simulate)]
    assert signatures[0].parameters == signatures[1].parameters
    for thing in (
        mcrt.plan,
        mcrt.simulate,
        mcrt.Medium,
        mcrt.Medium.box,
        mcrt.Isotropic.evaluate,
        mcrt.interop.to_mitsuba,
    ):
        assert "numpy._typing" not in str(inspect.signature(thing))
    assert "ArrayLike | Medium" in pydoc.plain(pydoc.render_doc(mcrt.simulate))


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_an_opaque_volume_without_extinction_is_told_its_units():
    counts = np.full((2, 3, 4), 255, dtype=np.uint8)
    for ran in (mcrt.plan(counts, photons=100), mcrt.simulate(counts, photons=100)):
        (warning,) = (w for w in ran.warnings if "extinction is not given" in w)
        assert "255" in warning
        assert "extinction: 0.00039 " in warning
    scaled = {"extinction": 0.1 / 255}
    for volume, arguments in ((counts, scaled), (counts, {"extinction": 1.0}), (density(), {})):
        warnings = mcrt.plan(volume, photons=100, **arguments).warnings
        assert not any("extinction is not given" in warning for warning in warnings)
    assert not mcrt.plan(mcrt.Medium.box(1000.0)).warnings


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "i8", "f2", "f4", "f8", "g"])
def test_dtype_does_not_matter(dtype):
    values = (4.0 * density()).astype(np.uint8)
    np.testing.assert_array_equal(run(values.astype(dtype)).fluence, run(values).fluence)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_does_not_matter(layout, grey):
    np.testing.assert_array_equal(run(LAYOUTS[layout](density())).fluence, grey.fluence)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_bool_is_zero_or_one():
    values = density() > 0.5
    np.testing.assert_array_equal(run(values).fluence, run(values.astype(np.float32)).fluence)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_integer_density_is_used_as_it_is():
    values = (255.0 * density()).astype(np.uint8)
    np.testing.assert_array_equal(
        run(values, extinction=0.01).fluence, run(values.astype(float), extinction=0.01).fluence
    )


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_the_input_is_copied_once_and_never_changed():
    values = density()
    medium = mcrt.Medium(values)
    values[:] = 7.0
    np.testing.assert_array_equal(medium.density, density())
    assert not medium.density.flags.writeable


def test_medium_means_the_same_as_arguments(grey):
    medium = mcrt.Medium(density(), spacing=SPACING, origin=ORIGIN, extinction=0.8)
    result = run(medium, spacing=None, origin=None, extinction=None)
    np.testing.assert_array_equal(result.fluence, grey.fluence)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_from_opacity_inverts_the_exponential():
    alpha = np.linspace(0.0, 0.99, 24).reshape(2, 3, 4)
    medium = mcrt.Medium.from_opacity(alpha, 0.5, albedo=0.3)
    np.testing.assert_allclose(1.0 - np.exp(-0.5 * medium.density), alpha, atol=1e-6)
    assert medium.albedo == 0.3


def test_rgb_has_a_last_axis(rgb):
    assert rgb.fluence.shape == rgb.absorbed_error.shape == (*SHAPE, 3)
    assert rgb.image().shape == rgb.alpha().shape == rgb.image_error().shape == (10, 14, 3)
    assert rgb.energy.absorbed.shape == (3,)


def test_three_albedos_are_rgb_even_for_three_voxels():
    result = mcrt.simulate(np.ones((1, 1, 3)), albedo=[0.9, 0.5, 0.1], photons=1000)
    assert result.fluence.shape == (1, 1, 3, 3)


def test_albedo_per_voxel_of_one_value_is_that_albedo(grey):
    result = run(albedo=np.full(SHAPE, 0.9))
    np.testing.assert_allclose(result.energy.absorbed, grey.energy.absorbed, rtol=1e-6)


def test_absorbed_is_sigma_a_times_fluence_in_constant_voxels(backend):
    result = run(interpolation="nearest")
    sigma_a = 0.1 * 0.8 * density()
    np.testing.assert_allclose(result.absorbed, sigma_a * result.fluence, rtol=1e-6)
    np.testing.assert_allclose(result.absorbed_error, sigma_a * result.fluence_error, rtol=1e-6)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
@pytest.mark.parametrize("photons", [4e3, np.int64(4000), np.float32(4000), np.array(4000)])
def test_photons_take_any_integral_number(photons, grey):
    np.testing.assert_array_equal(run(photons=photons).fluence, grey.fluence)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_do_not_change_a_bit(threads, grey):
    result = run(threads=threads)
    for name in ("fluence", "radiance", "fluence_error", "radiance_error"):
        np.testing.assert_array_equal(getattr(result, name), getattr(grey, name))
    np.testing.assert_array_equal(result.image(), grey.image())
    np.testing.assert_array_equal(result.image_error(), grey.image_error())


def test_another_seed_is_another_run(grey):
    assert (run(seed=2**64 - 1).fluence != grey.fluence).any()


def test_orders_add_up(grey):
    np.testing.assert_allclose(grey.image(), grey.image(order=1) + grey.image(order="2+"))
    assert (grey.image(order=0) == 0.0).all()


def test_alpha_is_opacity(grey):
    alpha = grey.alpha()
    assert alpha[0, 0] == 0.0
    assert 0.0 < alpha.max() < 1.0


def test_images_belong_to_the_caller_and_voxels_are_read_only(grey):
    before = grey.image(order=1)
    grey.image(order=1)[:] = -1.0
    np.testing.assert_array_equal(grey.image(order=1), before)
    with pytest.raises(ValueError, match="read-only"):
        grey.fluence[0, 0, 0] = 1.0


def test_another_camera_uses_the_same_photons(grey):
    assert grey.image(camera((0.0, 0.0, 0.0), (7, 5))).shape == (5, 7)


def test_energy_has_attributes_keys_and_a_sum(grey):
    energy = grey.energy
    assert energy.launched == energy["launched"] == pytest.approx(4e3 * np.pi)
    assert list(energy.escaped) == ["-x", "+x", "-y", "+y", "-z", "+z"]
    assert energy.sum() == pytest.approx(1.0, abs=1e-6 + 11.0 * energy.error)


def test_stats_tell_speed_and_certainty(grey):
    stats = grey.stats
    assert stats.photons >= 4000
    assert stats.photons_per_second > 0.0
    assert 0.0 < stats.median_relative_error < stats.relative_error_95
    seconds = sum(stats.seconds.values())
    assert stats.figure_of_merit == pytest.approx(1.0 / (stats.relative_error**2 * seconds))


def test_outputs_that_were_not_asked_for_are_named():
    result = run(outputs=("fluence",))
    assert result.fluence.shape == SHAPE
    with pytest.raises(mcrt.SceneError, match='outputs=\\("fluence", "radiance"\\)'):
        _ = result.radiance
    with pytest.raises(mcrt.SceneError, match='outputs=\\("fluence", "image"\\)'):
        result.image()


def test_errors_can_be_spared():
    result = run(errors=False)
    assert result.image().shape == (10, 14)
    for ask in (lambda: result.fluence_error, result.image_error):
        with pytest.raises(mcrt.SceneError, match="errors=True"):
            ask()
    assert result.stats.figure_of_merit is None


def test_single_holds_no_higher_orders():
    result = run(method="single", max_scatterings=None, photons=None)
    assert result.plan.method == "single"
    assert result.image().max() > 0.0
    with pytest.raises(mcrt.SceneError, match='method="photon"'):
        result.image(order="2+")
    assert (result.image_error() == 0.0).all()
    assert result.stats.relative_error == 0.0


def test_plan_explains_itself(grey):
    plan = mcrt.plan(density(), photons=1e6, method="photon")
    assert isinstance(plan, mcrt.Plan)
    assert plan.method == plan["method"] == grey.plan.method == "photon"
    assert plan.bytes > 0
    assert plan.seconds > 0.0
    text = " ".join(str(plan).split())  # its lines are wrapped
    for name, choice, reason in plan.decisions:
        assert f"{name} {choice} -- {reason}" in text
    assert "<table>" in plan._repr_html_()


def test_progress_is_reported():
    seen = []
    run(photons=3e5, progress=lambda fraction, info: seen.append((fraction, dict(info))))
    assert all(0.0 <= fraction <= 1.0 for fraction, _ in seen)
    assert [fraction for fraction, _ in seen] == sorted(fraction for fraction, _ in seen)


def test_progress_can_stop_the_run():
    result = run(photons=10**12, max_scatterings=50, progress=lambda fraction, info: False)
    assert result.stats.stopped_by == "progress"
    assert np.isfinite(result.fluence).all()


def test_an_exception_in_progress_comes_out():
    def fail(fraction, info):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run(photons=10**12, progress=fail)


def test_time_limit_stops_the_run():
    start = processor_seconds()
    result = run(photons=10**12, time_limit=0.3)
    # Kernels that are compiled first are not counted in the limit.
    assert processor_seconds() - start < 3.0
    assert result.stats.stopped_by == "time_limit"


@pytest.mark.cpu_only("test_gpu_trouble.py interrupts the GPU")
def test_ctrl_c_interrupts_within_a_fifth_of_a_second():
    # Batches are checked for it: 3 to 60 ms. Twice that on processors that share their caches.
    assert interrupted(lambda: run(photons=10**12), after=0.5) < 0.2


def test_other_threads_go_on_while_it_runs():
    ticks = []
    done = threading.Event()

    def tick():
        while not done.wait(0.01):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    run(photons=10**12, time_limit=0.5, threads=1)
    done.set()
    thread.join()
    assert len(ticks) > 10


@pytest.mark.cpu_only("phase functions are drawn from by themselves")
@pytest.mark.parametrize("phase", PHASES, ids=lambda phase: type(phase).__name__)
def test_phase_functions_integrate_to_one_and_are_sampled(phase):
    cosines = np.linspace(-1.0, 1.0, 20001)
    values = phase.evaluate(cosines)
    assert 2.0 * np.pi * np.trapezoid(values, cosines) == pytest.approx(1.0, abs=1e-6)
    mean = 2.0 * np.pi * np.trapezoid(values * cosines, cosines)
    drawn = phase.sample(100_000, seed=1)
    assert abs(drawn.mean() - mean) < 4.5 * drawn.std() / np.sqrt(drawn.size)  # fails 7e-6 of seeds
    assert phase.evaluate([[0.0, 0.5]]).shape == (1, 2)


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_records_are_normalised_frozen_and_comparable():
    light = mcrt.PointLight(np.array([1, 2, 3]), [1, 2, 3])
    assert light == mcrt.PointLight((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))
    with pytest.raises(AttributeError):
        light.intensity = 2.0
    assert mcrt.DirectionalLight((0, 0, -2)).direction == (0.0, 0.0, -2.0)


def test_a_sequence_of_lights_adds_up():
    one, two = mcrt.PointLight((30.0, -40.0, 50.0), 1e3), mcrt.DirectionalLight((0, 0, -1), 2.0)
    both = run(light=[one, two], method="single", photons=None).image()
    each = sum(run(light=x, method="single", photons=None).image() for x in (one, two))
    np.testing.assert_allclose(both, each, rtol=2e-6)


@pytest.mark.cpu_only("simulates nothing")
def test_cloud_is_a_cloud_in_empty_space():
    cloud = mcrt.datasets.cloud(64, seed=3)
    assert cloud.shape == (64, 64, 64)
    assert cloud.dtype == np.float32
    assert cloud.min() == 0.0
    assert cloud.max() <= 1.0
    assert 0.03 < (cloud > 0.5).mean() < 0.12  # 6 to 7 % of the volume by seeds
    assert all(cloud.take(i, axis=axis).max() == 0.0 for axis in range(3) for i in (0, -1))
    np.testing.assert_array_equal(cloud, mcrt.datasets.cloud(64, seed=3))


@pytest.mark.cpu_only("simulates nothing")
def test_head_is_the_real_one():
    head = mcrt.datasets.mni_head()
    assert head.shape == (189, 233, 197)
    assert head.dtype == np.float32
    assert (head.min(), head.max()) == (0.0, 1.0)
    assert (head == 0.0).mean() == pytest.approx(0.7825, abs=1e-4)


@pytest.mark.cpu_only("simulates nothing")
def test_info_is_printed(capsys):
    mcrt.show_info()
    assert mcrt.__version__ in capsys.readouterr().out
    shell = subprocess.run(
        [sys.executable, "-m", "mcrt", "info"], capture_output=True, text=True, check=True
    )
    assert "threads" in shell.stdout
