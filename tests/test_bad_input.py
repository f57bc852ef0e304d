"""A bad argument is an error that says what was given and where; nothing panics or gives NaN."""

import os
from collections import Counter
from functools import partial

import mcrt
import numpy as np
import pytest
from conftest import density, run
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

NAN, INF = float("nan"), float("inf")


def with_value(value, *index):
    values = density().astype(float)
    values[index] = value
    return values


def sky(value, *index):
    """A map of 4 x 8 texels, RGB if the index has three numbers, with one texel of its own."""
    values = np.ones((4, 8, 3)[: len(index)])
    values[index] = value
    return values


BAD_VOLUMES = {
    "nan": (with_value(NAN, 1, 2, 3), r"(?s)1 .*\(1, 2, 3\)"),
    "inf": (with_value(INF, 0, 0, 1), r"\(0, 0, 1\)"),
    "negative": (with_value(-1.0, 3, 4, 5), r"\(3, 4, 5\)"),
    "overflow": (with_value(1e39, 2, 0, 0), r"float32.*\(2, 0, 0\)"),
    "2-D": (np.ones((3, 4)), r"3-D array.*\(3, 4\)"),
    "4-D": (np.ones((1, 2, 3, 4)), r"3-D array.*\(1, 2, 3, 4\)"),
    "number": (3.0, "density must be a 3-D array.*3.0"),
    "none": (None, "density must be a 3-D array.*None"),
    "empty": (np.ones((3, 0, 4)), r"at least one voxel.*\(3, 0, 4\)"),
    "string": ("a string", "density must be.*'a string'"),
    "strings": (np.full((2, 2, 2), "1"), "density must be.*<U1"),
    "objects": (np.full((2, 2, 2), None), "density must be.*object"),
    "complex": (np.ones((2, 2, 2), dtype=complex), "density must be.*complex"),
    "dates": (np.zeros((2, 2, 2), dtype="M8[s]"), "density must be.*datetime"),
    "durations": (np.zeros((2, 2, 2), dtype="m8[s]"), "density must be.*timedelta"),
    "structured": (np.zeros((2, 2, 2), dtype=[("a", "f4")]), "density must be"),
    "masked": (np.ma.masked_equal(np.ones((2, 2, 2)), 1.0), "without a mask"),
    "ragged": ([[[1.0, 2.0], [3.0]]], "density must be"),
}

BAD_ARGUMENTS = [
    ({"spacing": 0.0}, "spacing"),
    ({"spacing": (1.0, -1.0, 1.0)}, "spacing"),
    ({"spacing": (1.0, 1.0)}, "spacing must be"),
    ({"spacing": NAN}, "spacing"),
    ({"origin": (0.0, 0.0)}, "origin must be 3 numbers"),
    ({"origin": (0.0, INF, 0.0)}, "origin"),
    ({"interpolation": "cubic"}, 'interpolation must be one of "nearest", "linear"; got .cubic'),
    ({"extinction": -1.0}, "extinction"),
    ({"extinction": NAN}, "extinction"),
    ({"extinction": (1.0, 2.0)}, "extinction must be a number or 3 numbers"),
    ({"extinction": "8"}, "extinction must be"),
    ({"extinction": True}, "extinction must be"),
    ({"albedo": 1.1}, "albedo"),
    ({"albedo": (0.5, -0.1, 0.5)}, "albedo"),
    ({"albedo": np.full((4, 5, 7), 0.5)}, r"albedo must be.*\(4, 5, 6\).*\(4, 5, 7\)"),
    ({"albedo": with_value(1.5, 1, 1, 1)}, r"\(1, 1, 1\)"),
    ({"phase": "isotropic"}, "phase must be Isotropic"),
    ({"phase": mcrt.HenyeyGreenstein}, "phase must be Isotropic"),
    ({"light": "sun"}, "light must be PointLight"),
    ({"light": [mcrt.PointLight((9, 9, 9)), 3]}, r"light\[1\]"),
    ({"camera": (1, 2, 3)}, "camera must be PerspectiveCamera"),
    ({"photons": 0}, "photons must be an integral number from 1 to 1,000,000,000,000,000"),
    ({"photons": -5}, "photons"),
    ({"photons": 1.5}, "photons"),
    ({"photons": 1e16}, "photons"),
    ({"photons": NAN}, "photons"),
    ({"photons": INF}, "photons"),
    ({"photons": True}, "photons"),
    ({"photons": "1e6"}, "photons"),
    ({"photons": [1000]}, "photons"),
    ({"target_error": 0.0}, "target_error must be a positive finite number"),
    ({"target_error": NAN}, "target_error"),
    ({"time_limit": -1.0}, "time_limit"),
    ({"time_limit": INF}, "time_limit"),
    ({"max_scatterings": -1}, "max_scatterings"),
    ({"max_scatterings": 1.5}, "max_scatterings"),
    ({"method": "foton"}, 'method must be one of "auto", "single", "photon", "path"; got .foton'),
    ({"method": None}, "method must be one of"),
    ({"tracker": "delta"}, "tracker must be one of"),
    ({"backend": "cuda"}, '"cuda".*"gpu:NAME"'),
    ({"backend": 1}, "backend must be"),
    ({"angular": "fine"}, "angular must be one of"),
    ({"angular": 9}, "angular"),
    ({"seed": -1}, "seed"),
    ({"seed": 2**64}, "seed"),
    ({"threads": 0}, "threads"),
    ({"errors": 1}, "errors must be True or False"),
    ({"force": "yes"}, "force must be True or False"),
    ({"outputs": ["fluence", "flux"]}, "outputs must be one of.*flux"),
    ({"outputs": []}, "outputs must be a sequence"),
    ({"progress": "bar"}, "progress must be"),
    ({"emission": np.ones((4, 5, 7))}, r"emission must be.*\(4, 5, 6\).*\(4, 5, 7\)"),
    ({"emission": np.ones((4, 5, 6, 2))}, "emission must be"),
    ({"emission": (1.0, 2.0)}, "emission must be"),
    ({"emission": "hot"}, "emission must be"),
    ({"emission": -1.0}, r"120 values of emission are .*\(0, 0, 0\): -1"),
    ({"emission": (1.0, NAN, 1.0)}, r"\(0, 0, 0, 1\): NaN"),
    ({"emission": with_value(NAN, 1, 2, 3)}, r"1 values of emission are .*\(1, 2, 3\): NaN"),
    ({"emission": with_value(-2.0, 3, 0, 1)}, r"\(3, 0, 1\): -2"),
    ({"emission": np.stack([with_value(INF, 3, 4, 5)] * 3, -1)}, r"\(3, 4, 5, 0\): inf"),
    ({"emission": with_value(1e300, 1, 1, 1)}, r"emission must fit float32.*\(1, 1, 1\)"),
    ({"emission": 1e30}, "radiance"),
    ({"detector": 1}, "detector is not yet available"),
    ({"spp": 0}, "spp must be"),
    ({"spp": 16, "method": "photon"}, "spp is for method"),
    ({"photons": None, "method": "path", "angular": "sh"}, "angular is for method"),
    ({"photons": 100, "method": "path"}, "photons is given, but method"),
    ({"photons": None, "method": "path", "outputs": ("fluence",)}, "images only"),
    (
        {"photons": None, "spp": 4, "light": mcrt.PencilBeam((0, 0, 0), (0, 0, 1))},
        'PencilBeam.*"photon"',
    ),
    ({"photoelectric": True}, "photoelectric is not yet available"),
    ({"tracker": "analytic"}, "analytic"),
]

BAD_RECORDS = [
    (partial(mcrt.HenyeyGreenstein, 1.0), "g"),
    (partial(mcrt.HenyeyGreenstein, -1.5), "g"),
    (partial(mcrt.HenyeyGreenstein, NAN), "g"),
    (partial(mcrt.HenyeyGreenstein, "0.5"), "g must be a number"),
    (partial(mcrt.TabulatedPhase, (-1, 1), (1, -1)), "values"),
    (partial(mcrt.TabulatedPhase, (-1, 1), (0, 0)), "values"),
    (partial(mcrt.TabulatedPhase, (1, -1), (1, 1)), "cos_theta"),
    (partial(mcrt.TabulatedPhase, (-1, 1), (1, 1, 1)), "values|cos_theta"),
    (partial(mcrt.TabulatedPhase, (), ()), "cos_theta"),
    (partial(mcrt.TabulatedPhase, 1, 1), "cos_theta must be a 1-D sequence"),
    (partial(mcrt.PointLight, (0, 0), 1), "position must be 3 numbers"),
    (partial(mcrt.PointLight, (0, 0, NAN), 1), "position"),
    (partial(mcrt.PointLight, (0, 0, 0), -1), "intensity"),
    (partial(mcrt.PointLight, (0, 0, 0), (1, 2)), "intensity must be"),
    (partial(mcrt.PencilBeam, (0, 0, 0), (0, 0, 0)), "direction"),
    (partial(mcrt.PencilBeam, (0, 0, 0), (0, 0, 1), INF), "power"),
    (partial(mcrt.DirectionalLight, (0, 0, 0)), "direction"),
    (partial(mcrt.DirectionalLight, (0, INF, 0)), "direction"),
    (partial(mcrt.DirectionalLight, (0, 0, 1), NAN), "irradiance"),
    (partial(mcrt.EnvironmentLight, -1.0), "radiance"),
    (partial(mcrt.EnvironmentLight, np.ones(4)), "radiance must be a number, 3 numbers"),
    (partial(mcrt.EnvironmentLight, np.ones((4, 8, 2))), r"radiance must be.*\(4, 8, 2\)"),
    (partial(mcrt.EnvironmentLight, np.ones((1, 4, 8, 3))), r"radiance must be.*\(1, 4, 8, 3\)"),
    (partial(mcrt.EnvironmentLight, np.ones((0, 8))), "at least one texel"),
    (partial(mcrt.EnvironmentLight, np.ones((4, 0, 3))), "at least one texel"),
    (partial(mcrt.EnvironmentLight, np.full((4, 8), "a")), "radiance must be"),
    (partial(mcrt.EnvironmentLight, sky(NAN, 2, 7)), r"1 values .*\[2, 7\]: NaN"),
    (partial(mcrt.EnvironmentLight, sky(-1.0, 3, 0)), r"\[3, 0\]: -1"),
    (partial(mcrt.EnvironmentLight, sky(INF, 0, 1, 2)), r"\[0, 1, 2\]: inf"),
    (partial(mcrt.EnvironmentLight, sky(1e300, 0, 1, 2)), r"float32.*\(0, 1, 2\)"),
    (partial(mcrt.PerspectiveCamera, (1, 2, 3), (1, 2, 3)), "target"),
    (partial(mcrt.PerspectiveCamera, (1, 2, 3), (0, 0, 0), fov=180.0), "fov"),
    (partial(mcrt.PerspectiveCamera, (1, 2, 3), (0, 0, 0), up=(0, 0, 0)), "up"),
    (partial(mcrt.PerspectiveCamera, (1, 2, 3), (0, 0, 0), resolution=600), "resolution must be"),
    (partial(mcrt.PerspectiveCamera, (1, 2, 3), (0, 0, 0), resolution=(0, 5)), "width must be"),
    (partial(mcrt.OrthographicCamera, (1, 2, 3), (0, 0, 0), width=0.0), "width"),
    (partial(mcrt.Medium, np.ones((2, 2, 2)), albedo="red"), "albedo must be"),
    (partial(mcrt.Medium.from_opacity, np.ones((2, 2, 2)), 1.0), r"alpha.*8 .*\(0, 0, 0\)"),
    (partial(mcrt.Medium.from_opacity, np.zeros((2, 2, 2)), 0.0), "step must be"),
    (partial(mcrt.Medium.from_opacity, np.zeros((2, 2, 2)), 1.0, extinction=2.0), "extinction"),
    (partial(mcrt.datasets.cloud, 0), "n must be"),
]


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize("name", BAD_VOLUMES)
def test_bad_volume_is_named(name):
    volume, message = BAD_VOLUMES[name]
    with pytest.raises(mcrt.SceneError, match=message):
        mcrt.simulate(volume, photons=1000)


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize(("arguments", "message"), BAD_ARGUMENTS, ids=lambda x: str(x)[:40])
def test_bad_argument_is_named(arguments, message):
    for call in (mcrt.simulate, mcrt.plan):
        if call is mcrt.plan and "progress" in arguments:
            continue
        with pytest.raises(mcrt.SceneError, match=message):
            call(density(), **({"photons": 1000} | arguments))


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize(("make", "message"), BAD_RECORDS, ids=range(len(BAD_RECORDS)))
def test_bad_record_is_rejected_where_it_is_made(make, message):
    with pytest.raises(mcrt.SceneError, match=message):
        make()


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize(
    "argument",
    [{"spacing": 1.0}, {"albedo": 0.9}, {"phase": mcrt.Isotropic()}, {"interpolation": "linear"}],
    ids=str,
)
def test_nothing_is_given_twice(argument):
    with pytest.raises(mcrt.SceneError, match=f"{next(iter(argument))} given both"):
        mcrt.simulate(mcrt.Medium(density()), photons=1000, **argument)


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize("order", [2, True, "1", "2", -1, 1.5, [], np.ones(2)], ids=str)
def test_unknown_order_is_named(order, grey):
    with pytest.raises(mcrt.SceneError, match="order must be"):
        grey.image(order=order)


@pytest.mark.cpu_only("arguments are checked before any backend")
def test_errors_are_of_the_documented_families():
    families = {
        mcrt.SceneError: ValueError,
        mcrt.VolumeTooLargeError: MemoryError,
        mcrt.NoAdapterError: RuntimeError,
        mcrt.DeviceLostError: RuntimeError,
    }
    for error, family in families.items():
        assert issubclass(error, family)
        assert issubclass(error, mcrt.McrtError)


def test_a_volume_beyond_the_memory_is_an_error():
    huge = np.broadcast_to(np.float32(1.0), (20000, 20000, 20000))
    with pytest.raises(mcrt.VolumeTooLargeError, match="20000"):
        mcrt.simulate(huge, photons=1000)


def test_another_eye_needs_an_isotropic_phase_function():
    result = run(phase=mcrt.HenyeyGreenstein(0.5))
    other = mcrt.PerspectiveCamera((0, 0, 0), (11, -17, 33), resolution=(4, 4))
    with pytest.raises(mcrt.SceneError, match="eye"):
        result.image(other)


# Thousands of calls, most of them nonsense

FLOATS = st.sampled_from([0.0, 0.3, 1.0, 2.5, 1e-6, 1e6, -1.0, 1e-38, 1e30, 1e300, NAN, INF])
SANE = st.sampled_from([0.1, 0.5, 1.0, 3.0])
JUNK = st.sampled_from(
    ["x", b"x", (), [], (1.0, 2.0), {"a": 1}, object(), 1j, True, np.array("x"), np.eye(2), 2**200]
)
POINTS = st.tuples(*[st.sampled_from([-4.0, 0.0, 0.5, 1.0, 1.5, 2.0, 7.0])] * 3)
WILD_POINTS = st.tuples(FLOATS, FLOATS, FLOATS)
VALUES = st.one_of(SANE, st.tuples(SANE, SANE, SANE))
WILD_VALUES = st.one_of(FLOATS, st.tuples(FLOATS, FLOATS, FLOATS), JUNK)
SIZES = st.tuples(*[st.integers(1, 5)] * 2)


def record(make, *fields, **named):
    """A phase, light or camera that the test makes itself, since that may fail too."""
    return st.builds(partial, st.just(make), *fields, **named)


def maps(numbers):
    shapes = st.tuples(st.integers(1, 3), st.integers(1, 3), st.sampled_from([1, 3]))
    return st.builds(
        lambda shape, some, rng: rng.choice(some, shape if shape[2] == 3 else shape[:2]),
        shapes,
        st.lists(numbers, min_size=1, max_size=3),
        st.builds(np.random.default_rng, st.integers(0, 5)),
    )


def lights(points, values, numbers):
    kinds = st.one_of(
        record(mcrt.PointLight, points, values),
        record(mcrt.PencilBeam, points, points, values),
        record(mcrt.DirectionalLight, points, values),
        record(mcrt.EnvironmentLight, values),
        record(mcrt.EnvironmentLight, maps(numbers)),
    )
    return st.one_of(kinds, st.lists(kinds, max_size=3))


def cameras(points, numbers):
    return st.one_of(
        record(mcrt.PerspectiveCamera, points, points, points, resolution=SIZES),
        record(mcrt.OrthographicCamera, points, points, points, numbers, resolution=SIZES),
    )


def volumes(values):
    shapes = st.tuples(*[st.integers(1, 4)] * 3)
    return st.builds(
        lambda shape, some, dtype, rng: rng.choice(some, shape).astype(dtype),
        shapes,
        st.lists(values, min_size=1, max_size=3),
        st.sampled_from(["f8", ">f8", "g"]),
        st.builds(np.random.default_rng, st.integers(0, 5)),
    )


GOOD = {
    "spacing": st.one_of(SANE, st.tuples(SANE, SANE, SANE)),
    "origin": POINTS,
    "interpolation": st.sampled_from(["nearest", "linear"]),
    "extinction": VALUES,
    "emission": VALUES,
    "albedo": st.sampled_from([0.0, 0.5, 1.0, (0.1, 0.5, 1.0), np.float32(0.9)]),
    "phase": st.one_of(
        record(mcrt.Isotropic),
        record(mcrt.Rayleigh),
        record(mcrt.HenyeyGreenstein, st.sampled_from([-0.9, 0.0, 1e-6, 0.99])),
        record(mcrt.TabulatedPhase, st.just((-1, 0, 1)), st.just((0, 1, 3))),
    ),
    "light": lights(POINTS, VALUES, SANE),
    "camera": cameras(POINTS, SANE),
    "max_scatterings": st.sampled_from([0, 1, 2, 5]),
    "method": st.sampled_from(["auto", "single", "photon"]),
    "tracker": st.sampled_from(["auto", "woodcock", "march"]),
    "target_error": st.sampled_from([0.5, 2.0]),
    "seed": st.sampled_from([0, 1, 2**64 - 1]),
    "threads": st.sampled_from([1, 2]),
    "errors": st.booleans(),
    "outputs": st.sampled_from([None, ["image"], ("fluence", "radiance")]),
}
WILD = {
    "spacing": WILD_VALUES,
    "origin": st.one_of(WILD_POINTS, JUNK),
    "interpolation": JUNK,
    "extinction": WILD_VALUES,
    "albedo": st.one_of(WILD_VALUES, volumes(FLOATS)),
    "phase": st.one_of(
        JUNK,
        record(mcrt.HenyeyGreenstein, FLOATS),
        record(mcrt.TabulatedPhase, st.lists(FLOATS, max_size=4), st.lists(FLOATS, max_size=4)),
    ),
    "light": st.one_of(JUNK, lights(WILD_POINTS, WILD_VALUES, FLOATS)),
    "camera": st.one_of(JUNK, cameras(WILD_POINTS, FLOATS)),
    "photons": st.one_of(JUNK, st.sampled_from([0, -1, 0.5, NAN, INF, 1e300, 1, 2, 17.0])),
    "max_scatterings": st.one_of(JUNK, st.sampled_from([-1, 0.5, NAN, 1e300])),
    "method": st.one_of(JUNK, st.just("path")),
    "tracker": st.one_of(JUNK, st.just("analytic")),
    "target_error": st.one_of(JUNK, st.sampled_from([0.0, -1.0, NAN, INF, 1e300])),
    "time_limit": st.one_of(JUNK, FLOATS),
    "seed": st.one_of(JUNK, st.sampled_from([-1, 2**64, 0.5, NAN])),
    "threads": st.one_of(JUNK, st.sampled_from([0, -1, 1e9])),
    "errors": JUNK,
    "outputs": JUNK,
    "emission": st.one_of(JUNK, WILD_VALUES, volumes(FLOATS)),
    "force": JUNK,
}


@st.composite
def calls(draw):
    """A volume and arguments: some good ones, and often one or two wild ones."""
    volume = draw(st.one_of(*[volumes(SANE)] * 4, volumes(st.just(0.0)), volumes(FLOATS), JUNK))
    count = draw(st.sampled_from([{"photons": 1}, {"photons": 100}, {"photons": 300}, {"spp": 3}]))
    # A photon would stay for hours in a million optical depths that absorb nothing.
    arguments = {"progress": False, "max_scatterings": 1000} | count
    for name in draw(st.sets(st.sampled_from(sorted(GOOD)), max_size=7)):
        arguments[name] = draw(GOOD[name])
    for name in draw(st.sets(st.sampled_from(sorted(WILD)), max_size=2)):
        arguments[name] = draw(WILD[name])
    if "spp" in arguments:  # every pixel has its paths
        arguments["camera"] = mcrt.PerspectiveCamera((9, -9, 9), (1, 1, 1), resolution=(4, 3))
    return volume, arguments


def made(value):
    if isinstance(value, list):
        return [made(one) for one in value]
    return value() if isinstance(value, partial) else value


def assert_finite(result, arguments, voxels):
    outputs, arrays = ("image",), []
    if result.plan.method != "path":
        for name, value in result.energy.items():
            if name.endswith("error"):
                # A single batch leaves it unknown: infinite.
                assert np.all(value >= 0), name
            else:
                arrays += value.values() if name == "escaped" else [value]
        outputs = arguments.get("outputs") or ("fluence", "radiance", "image")
    if voxels:
        arrays += [getattr(result, name) for name in ("fluence", "radiance") if name in outputs]
    if "image" in outputs and "camera" in arguments:
        arrays += [result.image(), result.image(order=0), result.alpha()]
    for array in arrays:
        assert np.isfinite(array).all()


@pytest.mark.cpu_only("random scenes run on both backends in test_gpu.py")
def test_any_call_gives_a_finite_result_or_an_mcrt_error():
    everything = bool(os.environ.get("MCRT_ALL_ON_GPU"))
    seen, count = Counter(), 2500 if everything else 600

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @example((np.ones((1, 1, 1)), {"photons": 1}))
    @example((np.zeros((2, 1, 3)), {"photons": 1, "albedo": (0.1, 0.2, 0.3)}))
    @given(calls())
    def call(volume_and_arguments):
        volume, arguments = volume_and_arguments
        try:
            arguments = {name: made(value) for name, value in arguments.items()}
            result = mcrt.simulate(volume, **arguments)
            # Unscattered light of voxels takes longer than all else: every third result's.
            assert_finite(result, arguments, voxels=everything or seen["result"] % 3 == 0)
            seen["result"] += 1
        except mcrt.McrtError:
            seen["error"] += 1

    call()
    assert seen.total() >= 0.8 * count
    assert min(seen.values()) > 0.2 * seen.total(), seen
