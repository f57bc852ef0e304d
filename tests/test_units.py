"""What NumPy would drop on the way to an array is an error: units and masked values.

Astropy, pint, unyt and dask are played by classes that show what those of these packages do.
"""

import mcrt
import numpy as np
import pytest

pytestmark = pytest.mark.cpu_only("arguments are checked before any backend")
V = np.ones((2, 3, 4))


class AstropyQuantity(np.ndarray):
    """A subclass of arrays, whose scalars refuse an index."""

    def __new__(cls, value, unit="1 / mm"):
        array = np.asarray(value, float).view(cls)
        array.unit = Unit(unit)
        return array

    def __array_finalize__(self, other):
        self.unit = getattr(other, "unit", None)

    def __getitem__(self, index):
        if not self.shape:
            raise TypeError("a scalar quantity does not support indexing")
        return AstropyQuantity(np.asarray(self)[index])

    @property
    def value(self):
        return np.asarray(self)

    def to(self, unit):
        return self


class Unit:
    def __init__(self, name):
        self.name = name

    def __str__(self):
        return self.name


class PintQuantity:
    """Wraps a number or an array, and strips the unit where an array is wanted."""

    def __init__(self, magnitude, units="millimeter"):
        self.magnitude, self.units = np.asarray(magnitude), Unit(units)

    def __array__(self, dtype=None, copy=None):
        return self.magnitude

    def __float__(self):
        return float(self.magnitude)

    def __len__(self):
        return len(self.magnitude)

    def __getitem__(self, index):
        return PintQuantity(self.magnitude[index])

    def to(self, unit):
        return self


class DaskArray:
    """Drops the mask of its chunks where an array is wanted."""

    def __init__(self, computed):
        self.computed, self.times = computed, 0

    def compute(self):
        self.times += 1
        return self.computed

    def __dask_graph__(self):
        return {}

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.computed)


class OnlyDLPack:
    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


class OnTheDevice(OnlyDLPack):
    def __dlpack__(self, **options):
        raise BufferError("cannot export an array of the device")


def plan(volume=V, **arguments):
    return mcrt.plan(volume, **({"photons": 100} | arguments))


CAMERA = mcrt.PerspectiveCamera
NUMBERS = {
    "spacing": lambda q: plan(spacing=q(2.0)),
    "spacing x 3": lambda q: plan(spacing=q([1.0, 2.0, 3.0])),
    "one of 3": lambda q: plan(spacing=(1.0, q(2.0), 3.0)),
    "origin": lambda q: plan(origin=[q(1.0), q(2.0), q(3.0)]),
    "extinction": lambda q: plan(extinction=q(8.0)),
    "albedo": lambda q: plan(albedo=q(0.5)),
    "albedo per voxel": lambda q: plan(albedo=q(0.5 * V)),
    "emission": lambda q: plan(emission=q(1.0)),
    "emission per voxel": lambda q: plan(emission=[q(V[0]), q(V[1])]),
    "density": lambda q: plan(q(V)),
    "slices of density": lambda q: plan([q(V[0]), V[1]]),
    "photons": lambda q: plan(photons=q(100.0)),
    "spp": lambda q: plan(photons=None, spp=q(4.0)),
    "target_error": lambda q: plan(target_error=q(0.1)),
    "time_limit": lambda q: plan(time_limit=q(5.0)),
    "max_scatterings": lambda q: plan(max_scatterings=q(3)),
    "angular": lambda q: plan(angular=q(3)),
    "seed": lambda q: plan(seed=q(3)),
    "threads": lambda q: plan(threads=q(1)),
    "medium": lambda q: mcrt.Medium(q(V)),
    "box": lambda q: mcrt.Medium.box(q([1.0, 2.0, 3.0])),
    "radius": lambda q: mcrt.Medium.sphere(q(1.0)),
    "center": lambda q: mcrt.Medium.sphere(1.0, center=q([1.0, 2.0, 3.0])),
    "alpha": lambda q: mcrt.Medium.from_opacity(q(0.5 * V), 1.0),
    "step": lambda q: mcrt.Medium.from_opacity(0.5 * V, q(1.0)),
    "position": lambda q: mcrt.PointLight(q([1.0, 2.0, 3.0])),
    "intensity": lambda q: mcrt.PointLight((1, 2, 3), q(1.0)),
    "direction": lambda q: mcrt.DirectionalLight(q([0.0, 0.0, 1.0])),
    "irradiance": lambda q: mcrt.DirectionalLight((0, 0, 1), [q(1.0), 1.0, 1.0]),
    "power": lambda q: mcrt.PencilBeam((1, 2, 3), (0, 0, 1), q(1.0)),
    "radiance": lambda q: mcrt.EnvironmentLight(q(1.0)),
    "map": lambda q: mcrt.EnvironmentLight(q(np.ones((4, 8)))),
    "eye": lambda q: CAMERA(q([1.0, 2.0, 3.0]), (0, 0, 0)),
    "target": lambda q: CAMERA((1, 2, 3), (q(0.0), 0, 0)),
    "up": lambda q: CAMERA((1, 2, 3), (0, 0, 0), up=q([0.0, 0.0, 1.0])),
    "fov": lambda q: CAMERA((1, 2, 3), (0, 0, 0), fov=q(40.0)),
    "resolution": lambda q: CAMERA((1, 2, 3), (0, 0, 0), resolution=(q(4), 4)),
    "resolution x 2": lambda q: CAMERA((1, 2, 3), (0, 0, 0), resolution=q([4, 4])),
    "width": lambda q: mcrt.OrthographicCamera((1, 2, 3), (0, 0, 0), width=q(40.0)),
    "g": lambda q: mcrt.HenyeyGreenstein(q(0.5)),
    "table": lambda q: mcrt.TabulatedPhase((-1, 1), q([1.0, 1.0])),
    "cosine": lambda q: mcrt.Isotropic().evaluate(q(0.5)),
    "cloud": lambda q: mcrt.datasets.cloud(q(8)),
    "to_mitsuba": lambda q: mcrt.interop.to_mitsuba(V, extinction=q(8.0)),
}


@pytest.mark.parametrize("quantity", [AstropyQuantity, PintQuantity])
@pytest.mark.parametrize("where", NUMBERS)
def test_a_quantity_with_a_unit_is_refused_with_what_to_pass(where, quantity):
    number = {AstropyQuantity: "value", PintQuantity: "magnitude"}[quantity]
    with pytest.raises(mcrt.SceneError, match=rf'without a unit; .*\.to\(".+"\)\.{number} gives'):
        NUMBERS[where](quantity)


def test_a_quantity_computed_late_is_refused():
    with pytest.raises(mcrt.SceneError, match="without a unit"):
        plan(DaskArray(AstropyQuantity(V)))


def test_an_array_of_quantities_is_refused():
    array = np.empty(3, dtype=object)
    array[:] = [PintQuantity(1.0)] * 3
    with pytest.raises(mcrt.SceneError, match=r"without a unit; .*\.magnitude"):
        plan(origin=array)


def test_arrays_that_only_may_have_a_unit_are_taken():
    column = AstropyQuantity([1.0, 2.0, 3.0])
    column.unit = None
    assert mcrt.Medium(V, spacing=column).spacing == (1.0, 2.0, 3.0)


MASKED = np.ma.masked_array(V, np.zeros(V.shape, bool))
MASKED[1, 2, 3] = np.ma.masked
UNMASKED = np.ma.masked_array(V, np.zeros(V.shape, bool))
NESTS = {
    "itself": lambda a: a,
    "list": list,
    "lists of lists": lambda a: [list(plane) for plane in a],
    "tuple in list": lambda a: [tuple(a[0]), tuple(a[1])],
    "numbers": lambda a: [[[a[k, j, i] for i in range(4)] for j in range(3)] for k in range(2)],
    "dask": DaskArray,
    "list of dask": lambda a: [DaskArray(a[0]), DaskArray(a[1])],
}


@pytest.mark.parametrize("nest", NESTS)
@pytest.mark.parametrize("argument", ["density", "albedo", "emission"])
def test_a_masked_value_is_refused_in_any_nesting(nest, argument):
    given = NESTS[nest](MASKED)
    with pytest.raises(mcrt.SceneError, match=rf"{argument} must be .*without a masked value"):
        mcrt.Medium(given if argument == "density" else V, **without_density(argument, given))


@pytest.mark.parametrize("nest", NESTS)
@pytest.mark.parametrize("argument", ["density", "albedo", "emission"])
def test_a_masked_array_without_a_masked_value_is_taken(nest, argument):
    given = NESTS[nest](UNMASKED)
    medium = mcrt.Medium(given if argument == "density" else V, **without_density(argument, given))
    np.testing.assert_array_equal(getattr(medium, argument), V)


def without_density(argument, given):
    return {} if argument == "density" else {argument: given}


def test_masked_numbers_are_refused_and_others_taken():
    for masked in (np.ma.masked, np.ma.masked_array(3.0, True)):
        for where in (lambda m: plan(extinction=m), lambda m: plan(spacing=(1, m, 1))):
            with pytest.raises(mcrt.SceneError, match="masked"):
                where(masked)
    assert mcrt.Medium(V, extinction=np.ma.masked_array(3.0)).extinction == 3.0


def test_lazy_arrays_are_computed_once():
    lazy = DaskArray(V)
    mcrt.Medium(lazy)
    assert lazy.times == 1


def test_arrays_that_know_only_dlpack_are_taken():
    medium = mcrt.Medium(OnlyDLPack(V), albedo=OnlyDLPack(0.5 * V), emission=OnlyDLPack(V))
    np.testing.assert_array_equal(medium.density, V)
    np.testing.assert_array_equal(medium.albedo, np.float32(0.5 * V))
    np.testing.assert_array_equal(medium.emission, V)
    np.testing.assert_array_equal(mcrt.Medium([OnlyDLPack(plane) for plane in V]).density, V)
    sky = np.arange(32.0).reshape(4, 8)
    np.testing.assert_array_equal(mcrt.EnvironmentLight(OnlyDLPack(sky)).radiance, sky)


def test_an_array_that_cannot_leave_its_device_says_so():
    with pytest.raises(mcrt.SceneError, match="cannot export an array of the device"):
        plan(OnTheDevice(V))


def test_slices_of_unequal_shapes_are_named():
    with pytest.raises(mcrt.SceneError, match=r"2 arrays of the shapes \(3, 4\), \(3, 5\)"):
        plan([V[0], np.ones((3, 5))])
