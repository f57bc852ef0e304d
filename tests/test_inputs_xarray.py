"""An `xarray.DataArray` lies where its names and coordinates say, or is refused with the reason."""

import itertools

import mcrt
import numpy as np
import pytest
from conftest import ORIGIN, SHAPE, SPACING, density, run

xarray = pytest.importorskip("xarray")
pytestmark = pytest.mark.cpu_only("what the core is given does not depend on the backend")

CENTRES = {
    axis: ORIGIN["xyz".index(axis)] + (np.arange(n) + 0.5) * step
    for axis, n, step in zip("zyx", SHAPE, SPACING, strict=True)
}
ON_ITS_OWN = {"spacing": None, "origin": None}


def labelled(values=None, dims="zyx", z="z", descending=(), units=None, coordinates=True):
    """The small volume of the other tests, axes in the order `dims`, some of them descending."""
    values = density() if values is None else values
    attributes = {} if units is None else {"units": units}
    array = xarray.DataArray(
        values,
        dims=("z", "y", "x", "channel")[: values.ndim],
        coords={axis: (axis, c, attributes) for axis, c in CENTRES.items()} if coordinates else {},
    )
    array = array.isel({axis: slice(None, None, -1) for axis in descending})
    return array.transpose(*dims, ...).rename({"z": z} if z != "z" else {})


def medium(*arguments, **named):
    return mcrt.Medium(labelled(*arguments, **named))


@pytest.mark.parametrize("dims", list(itertools.permutations("zyx")))
@pytest.mark.parametrize("descending", ["", "z", "yx", "zyx"])
def test_axes_are_known_by_name_and_flipped_to_ascend(dims, descending):
    found = medium(dims=dims, descending=descending)
    np.testing.assert_array_equal(found.density, density())
    np.testing.assert_allclose(found.spacing, SPACING, rtol=1e-12)
    np.testing.assert_allclose(found.origin, ORIGIN, rtol=1e-12)


@pytest.mark.parametrize("z", ["z", "height", "altitude", "lev", "level", "Z"])
def test_z_has_several_names(z):
    np.testing.assert_array_equal(medium(dims="xyz", z=z).density, density())


def test_the_run_is_that_of_the_array_that_lies_there(grey):
    result = run(labelled(dims="xzy", descending="z"), **ON_ITS_OWN)
    np.testing.assert_array_equal(result.fluence, grey.fluence)
    np.testing.assert_array_equal(result.image(), grey.image())


def test_names_without_coordinates_order_the_axes(grey):
    result = run(labelled(dims="xzy", coordinates=False))
    np.testing.assert_array_equal(result.fluence, grey.fluence)
    np.testing.assert_array_equal(run(xarray.DataArray(density())).fluence, grey.fluence)
    variable = labelled(dims="xzy").variable
    np.testing.assert_array_equal(mcrt.Medium(variable).density, density())


def test_coordinates_may_be_rounded_to_their_dtype():
    """10 m in single precision, 5000 km from the origin: rounded to half a metre."""
    x = (5e6 + 10.0 * np.arange(40)).astype(np.float32)
    array = xarray.DataArray(
        np.ones((2, 2, 40)), dims=("z", "y", "x"), coords={"z": [0, 1], "y": [0, 1], "x": x}
    )
    found = mcrt.Medium(array, albedo=0.5 * array)
    assert found.spacing == pytest.approx((1.0, 1.0, 10.0), rel=2e-3)
    assert found.origin[0] == pytest.approx(5e6 - 5.0, abs=0.5)


def test_the_plan_says_what_was_read():
    array = labelled(dims="xzy", descending="z", z="height", units="metres")
    for plan in (mcrt.plan(array, photons=100), mcrt.simulate(array, photons=100).plan):
        name, choice, reason = plan.decisions[0]
        assert name == "volume"
        assert "dims (x, height, y) taken as (z, y, x)" in choice
        assert "height flipped" in choice
        assert "spacing (1.5, 1, 0.5)" in reason
        assert "origin (10, -20, 30) in m " in reason
    assert all(name != "volume" for name, _, _ in mcrt.plan(density()).decisions)


def test_results_come_back_in_the_frame_of_the_input(tmp_path):
    array = labelled(dims="xzy", descending="y", z="height", units="km")
    result = run(array, interpolation="nearest", **ON_ITS_OWN)
    result.save(tmp_path / "result.npz")
    for found in (result.to_xarray(), mcrt.Result.load(tmp_path / "result.npz").to_xarray()):
        fluence = found["fluence"]
        assert fluence.dims == ("height", "y", "x")
        assert fluence.attrs["units"] == "W/km²"
        assert found["height"].attrs["units"] == "km"
        absorbed = fluence * array * 0.8 * 0.1  # joined by equal coordinates
        assert dict(absorbed.sizes) == dict(array.sizes)
        np.testing.assert_allclose(absorbed.transpose("height", "y", "x"), found["absorbed"], 1e-5)


def test_runs_of_the_same_labelled_volume_merge():
    array = labelled(dims="xzy")
    merged = run(array, **ON_ITS_OWN) + run(array, **ON_ITS_OWN, seed=1)
    assert merged.to_xarray()["fluence"].dims == ("z", "y", "x")


def test_what_is_given_beside_coordinates_must_be_what_they_say():
    array = labelled()
    assert mcrt.Medium(array, spacing=SPACING, origin=ORIGIN).spacing == SPACING
    with pytest.raises(mcrt.SceneError, match=r"spacing = \(1, 1, 1\) is given.*\(1.5, 1, 0.5\)"):
        mcrt.Medium(array, spacing=1.0)
    with pytest.raises(mcrt.SceneError, match=r"origin = \(0, 0, 0\) is given.*\(10, -20, 30\)"):
        mcrt.Medium(array, origin=(0, 0, 0))
    for spacing in (0.0, np.nan, -1.0, (0.0, 1.0, 0.5)):
        with pytest.raises(mcrt.SceneError, match="spacing"):
            mcrt.plan(array.isel(z=[0]), spacing=spacing)
    with pytest.raises(mcrt.SceneError, match="spacing given both"):
        mcrt.plan(mcrt.Medium(array), spacing=1.0)


def test_one_layer_needs_a_spacing_and_takes_its_place_from_the_coordinate():
    layer = labelled().isel(z=[2])
    with pytest.raises(mcrt.SceneError, match=r"z has one voxel.*spacing=\(dz, dy, dx\)"):
        mcrt.Medium(layer)
    assert mcrt.Medium(layer, spacing=SPACING).origin == pytest.approx((10.0, -20.0, 33.0))


def test_albedo_and_emission_lie_where_the_density_does():
    values = np.random.default_rng(1).random((*SHAPE, 3))
    found = mcrt.Medium(
        labelled(dims="xyz", descending="y"),
        albedo=labelled(values[..., 0], dims="yzx", descending="z"),
        emission=labelled(values, dims="xzy", descending="x"),
    )
    np.testing.assert_array_equal(found.albedo, np.float32(values[..., 0]))
    np.testing.assert_array_equal(found.emission, np.float32(values))
    bare = mcrt.Medium(density(), albedo=labelled(values[..., 0], "xyz", coordinates=False))
    np.testing.assert_array_equal(bare.albedo, np.float32(values[..., 0]))


def test_albedo_and_emission_elsewhere_are_refused():
    half = labelled(np.full(SHAPE, 0.5))
    for name in ("albedo", "emission"):
        with pytest.raises(mcrt.SceneError, match=f"{name} must have the coordinates"):
            mcrt.Medium(labelled(), **{name: half.assign_coords(x=half.x + 0.25)})
        with pytest.raises(mcrt.SceneError, match=f"{name} must have the coordinates"):
            mcrt.Medium(density(), **{name: half})
        with pytest.raises(mcrt.SceneError, match=f"{name} must be an xarray.DataArray, as the"):
            mcrt.Medium(labelled(descending="z"), **{name: half.values})
        with pytest.raises(mcrt.SceneError, match=f"{name} has no coordinates, and z of the"):
            mcrt.Medium(labelled(descending="z"), **{name: half.drop_vars(["z", "y", "x"])})
        assert mcrt.Medium(labelled(), **{name: half.values}).density.shape == SHAPE


def test_opacities_keep_their_frame():
    alpha = labelled(np.full(SHAPE, 0.5), dims="xyz", descending="z")
    found = mcrt.Medium.from_opacity(alpha, 1.0)
    assert found.spacing == pytest.approx(SPACING)
    np.testing.assert_allclose(found.density, np.log(2.0), rtol=1e-6)


def with_units(**units):
    array = labelled()
    for axis, unit in units.items():
        array[axis].attrs["units"] = unit
    return array


def test_units_of_length_in_several_spellings_are_one():
    assert mcrt.Medium(with_units(z="m", y="metres", x="meter")).frame.unit == "m"


COUNTS_DOWN = labelled()
COUNTS_DOWN.z.attrs["positive"] = "down"
REFUSED = {
    "uneven": (
        labelled().assign_coords(z=[1.0, 2.0, 4.0, 8.0]),
        r"z is not evenly spaced.* 1 to 4; .*da.interp\(z=np.linspace\(1, 8, 4\)\)",
    ),
    "repeated": (labelled().assign_coords(x=np.ones(6)), "x is not evenly spaced"),
    "times": (labelled().assign_coords(z=np.arange(4).astype("M8[D]")), "z is of dtype datetime64"),
    "words": (labelled().assign_coords(z=list("abcd")), "z is of dtype .*lengths"),
    "nan": (labelled().assign_coords(z=[1.0, 2.0, np.nan, 4.0]), "z is not finite"),
    "longitude": (labelled().rename(x="lon"), "lon is an angle.*da.interp"),
    "degrees": (with_units(x="degrees_east", y="degrees_north", z="m"), "in degrees.*no length"),
    "pressure": (with_units(x="m", y="m", z="hPa"), "z is in hPa, which is no length"),
    "km and m": (with_units(x="km", y="km", z="m"), "differ in their units.*z in m.*x in km"),
    "m and none": (with_units(x="m", y="m"), "differ in their units.*z in no unit"),
    "depth": (labelled().rename(z="depth"), r"depth counts downwards: da.assign_coords"),
    "positive down": (COUNTS_DOWN, "z counts downwards"),
    "time": (labelled().expand_dims(time=[0]), r"pick one time: da.isel\(time=0\)"),
    "two z": (
        labelled().rename(x="height"),
        "two of them mean the same axis, the second is height",
    ),
    "unknown": (
        labelled().rename(x="i", y="j", z="k"),
        r"k is none of x, y, z.*da.rename\(k='z'\)",
    ),
    "2-D": (labelled().isel(z=0), "x, y and z .* are needed"),
    "some coordinates": (
        labelled().drop_vars("x"),
        r"x has no coordinate.*drop_vars\(\['z', 'y'\]\)",
    ),
    "another along z": (
        labelled().assign_coords(height=("z", [0.0, 1.0, 3.0, 6.0])),
        r"height lies along z.*da.swap_dims\(z='height'\)",
    ),
    "empty": (labelled().isel(y=[]), "at least one voxel"),
    "dataset": (labelled().to_dataset(name="qc"), r"Dataset.*'qc'.*dataset\[name\]"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_says_no_place_is_refused_with_the_reason(why):
    array, message = REFUSED[why]
    with pytest.raises(mcrt.SceneError, match=message):
        mcrt.plan(array)


def test_the_way_out_that_is_told_is_taken():
    depth = labelled().rename(z="depth")
    turned = depth.assign_coords(z=("depth", -depth.depth.values)).swap_dims(depth="z")
    np.testing.assert_array_equal(mcrt.Medium(turned).density, density()[::-1])
    uneven = labelled().assign_coords(z=[1.0, 2.0, 4.0, 8.0])
    assert mcrt.Medium(uneven.interp(z=np.linspace(1, 8, 4))).spacing[0] == pytest.approx(7 / 3)
    height = labelled().assign_coords(height=("z", [0.0, 1.0, 2.0, 3.0]))
    height = height.swap_dims(z="height").drop_vars("z")
    assert mcrt.Medium(height).spacing[0] == 1.0


def test_labels_that_have_no_meaning_are_refused():
    sky = xarray.DataArray(np.ones((4, 8)), dims=("lat", "lon"))
    with pytest.raises(mcrt.SceneError, match=r"dims \('lat', 'lon'\).*\.values"):
        mcrt.EnvironmentLight(sky)
    with pytest.raises(mcrt.SceneError, match=r"spacing must be .*dims \('axis',\)"):
        mcrt.Medium(density(), spacing=xarray.DataArray([1.0, 2.0, 3.0], dims="axis"))
    assert mcrt.Medium(density(), extinction=xarray.DataArray(3.0)).extinction == 3.0


def test_units_and_masks_inside_are_refused():
    class Quantity(np.ndarray):
        unit = object()

        def __array_function__(self, function, types, arguments, named):
            arguments = [np.asarray(a) if isinstance(a, Quantity) else a for a in arguments]
            return function(*arguments, **named).view(Quantity)

    array = xarray.DataArray(density().view(Quantity), dims=("z", "y", "x"))
    assert type(array.data) is Quantity
    with pytest.raises(mcrt.SceneError, match="without a unit"):
        mcrt.Medium(array)
    hidden = xarray.DataArray(np.ma.masked_less(density(), 0.3), dims=("z", "y", "x"))
    with pytest.raises(mcrt.SceneError, match="NaN"):  # xarray fills with it
        mcrt.plan(hidden)
