"""Results survive files, merges and displays."""

import base64
import io
import re

import matplotlib.pyplot as plt
import mcrt
import numpy as np
import pytest
from conftest import CENTRE, ORIGIN, SHAPE, SPACING, camera, run
from mcrt import display

pytestmark = pytest.mark.cpu_only("writes arrays, whoever made them")

OTHER = camera((0.0, -30.0, 60.0), (9, 8))


@pytest.mark.parametrize("kind", ["grey", "rgb"])
def test_save_and_load_keep_everything(kind, request, tmp_path):
    result = request.getfixturevalue(kind)
    result.save(tmp_path / "result.npz")
    again = mcrt.Result.load(tmp_path / "result.npz")
    for name in ("fluence", "radiance_error", "absorbed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    np.testing.assert_array_equal(again.image(OTHER), result.image(OTHER))
    np.testing.assert_array_equal(again.image_error(), result.image_error())
    assert again.camera == result.camera
    assert str(again) == str(result)
    assert str(again.plan) == str(result.plan)


def test_a_loaded_result_merges_with_a_fresh_one(tmp_path):
    phase = mcrt.TabulatedPhase((-1, 0, 1), (1, 2, 3))
    run(phase=phase, seed=1).save(tmp_path / "one.npz")
    merged = mcrt.Result.load(tmp_path / "one.npz") + run(phase=phase, seed=2)
    assert merged.stats.photons >= 8000


@pytest.mark.cpu_only("no result of a simulation")
@pytest.mark.parametrize("content", [b"", b"nonsense", b"PK\x03\x04broken"])
def test_a_file_of_something_else_is_an_error(content, tmp_path):
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(mcrt.SceneError, match=r"other\.npz"):
        mcrt.Result.load(path)
    np.savez(path, a=1)
    with pytest.raises(mcrt.SceneError, match=r"other\.npz"):
        mcrt.Result.load(path)


def test_merge_is_the_mean_weighted_by_photons(grey):
    other = run(seed=1, photons=12000)
    merged = grey + other
    n, m = grey.stats.photons, other.stats.photons
    a, b = n / (n + m), m / (n + m)
    assert merged.stats.photons == n + m
    np.testing.assert_allclose(merged.fluence, a * grey.fluence + b * other.fluence, rtol=1e-5)
    np.testing.assert_allclose(
        merged.fluence_error, np.hypot(a * grey.fluence_error, b * other.fluence_error), rtol=1e-5
    )
    mean = a * grey.image(OTHER) + b * other.image(OTHER)
    np.testing.assert_allclose(merged.image(OTHER), mean, rtol=1e-4)
    mean = a * grey.energy.absorbed + b * other.energy.absorbed
    assert merged.energy.absorbed == pytest.approx(mean)
    assert merged.energy.launched == pytest.approx(grey.energy.launched)


def test_merging_halves_the_variance(grey):
    merged = grey + run(seed=1) + run(seed=2) + run(seed=3)
    ratio = np.median(merged.image_error()) / np.median(grey.image_error())
    assert 0.3 < ratio < 0.75


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({}, "same seed"),
        ({"seed": 1, "extinction": 0.7}, "extinction differs"),
        ({"seed": 1, "volume": np.ones(SHAPE)}, "density differs"),
        ({"seed": 1, "max_scatterings": 4}, "max_scatterings"),
        ({"seed": 1, "outputs": ["image"]}, "outputs"),
    ],
)
def test_only_independent_runs_of_one_scene_merge(other, message, grey):
    with pytest.raises(mcrt.SceneError, match=message):
        grey + run(**other)


def test_a_seed_counts_once_in_a_merge(grey):
    other = run(seed=1)
    with pytest.raises(mcrt.SceneError, match="same seed"):
        grey + other + other
    with pytest.raises(TypeError):
        grey + 1.0


@pytest.mark.cpu_only("shows arrays, whoever made them")
@pytest.mark.parametrize("kind", ["grey", "rgb"])
def test_exr_has_the_layers(kind, request, tmp_path):
    openexr = pytest.importorskip("OpenEXR")
    result = request.getfixturevalue(kind)
    result.save_exr(tmp_path / "image.exr", OTHER)
    with openexr.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    layers = {"": None, "total.": None, "order0.": 0, "order1.": 1, "order2plus.": "2+"}
    assert set(channels) == {layer + name for layer in layers for name in "RGB"} | {"A"}
    for layer, order in layers.items():
        image = result.image(OTHER, order)
        for i, name in enumerate("RGB"):
            expected = image[..., i] if image.ndim == 3 else image
            np.testing.assert_array_equal(channels[layer + name], expected)
    alpha = result.alpha(OTHER)
    np.testing.assert_allclose(channels["A"], alpha.mean(-1) if alpha.ndim == 3 else alpha)


@pytest.mark.cpu_only("no result of a simulation")
@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (5, 7, 3)])
def test_png_keeps_every_pixel(shape):
    pixels = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    decoded = plt.imread(io.BytesIO(display.encode_png(pixels)), format="png")
    np.testing.assert_array_equal(np.rint(255.0 * decoded), pixels)


@pytest.mark.cpu_only("no result of a simulation")
def test_tone_map_is_monotonic_and_takes_black():
    ramp = np.linspace(0.0, 50.0, 256, dtype=np.float32).reshape(16, 16)
    mapped = display.tone_map(ramp).ravel().astype(int)
    assert (np.diff(mapped) >= 0).all()
    assert (mapped[0], mapped[-1] > 200) == (0, True)
    assert (display.tone_map(np.zeros((4, 4, 3))) == 0).all()


@pytest.mark.cpu_only("shows arrays, whoever made them")
@pytest.mark.parametrize("kind", ["grey", "rgb"])
def test_html_shows_picture_and_numbers(kind, request, tmp_path):
    result = request.getfixturevalue(kind)
    html = result._repr_html_()
    png = base64.b64decode(re.search(r"data:image/png;base64,([^\"]+)", html)[1])
    result.save_png(tmp_path / "image.png")
    assert png == (tmp_path / "image.png").read_bytes()
    for word in ("photon", "took", "error", "absorbed"):
        assert word in html


@pytest.mark.cpu_only("shows arrays, whoever made them")
def test_html_without_an_image_has_the_table_alone():
    html = run(outputs=["fluence"])._repr_html_()
    assert "<img" not in html
    assert "<table>" in html


@pytest.mark.cpu_only("shows arrays, whoever made them")
def test_xarray_has_coordinates_and_units(rgb):
    pytest.importorskip("xarray")
    data = rgb.to_xarray()
    assert data["fluence"].dims == ("z", "y", "x", "channel")
    assert data["absorbed_error"].attrs["units"] == "W/length³"
    for axis, n, step, lower in zip("zyx", SHAPE, SPACING, ORIGIN[::-1], strict=True):
        np.testing.assert_allclose(data[axis], lower + (np.arange(n) + 0.5) * step)
        centre = CENTRE["xyz".index(axis)]
        assert float(data[axis].mean()) == pytest.approx(centre)
    np.testing.assert_array_equal(data["image"], rgb.image())


@pytest.mark.cpu_only("shows arrays, whoever made them")
@pytest.mark.parametrize("kind", ["grey", "rgb"])
def test_plots_are_drawn_in_world_coordinates(kind, request):
    result = request.getfixturevalue(kind)
    ax = result.plot_slice("absorbed", axis="y", index=-1)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "z")
    assert ax.images[0].get_extent() == [10.0, 13.0, 30.0, 36.0]
    result.plot_slice(log=True)
    result.plot_image(OTHER, order=1)
    plt.close("all")
    with pytest.raises(mcrt.SceneError, match="quantity"):
        result.plot_slice("colour")
    with pytest.raises(mcrt.SceneError, match="index"):
        result.plot_slice(index=99)


def test_texts_are_short(grey):
    assert "photon" in repr(grey)
    assert "\n" not in repr(grey)
    assert "escaped" in str(grey)


def test_a_file_keeps_the_seed_lest_a_run_be_merged_with_itself(tmp_path):
    result = run(seed=3)
    result.save(tmp_path / "result.npz")
    loaded = mcrt.Result.load(tmp_path / "result.npz")
    with pytest.raises(mcrt.SceneError, match="same seed"):
        loaded + result
    assert (loaded + run(seed=1)).stats.photons == 2 * result.stats.photons
