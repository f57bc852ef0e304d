"""What a result is asked for it finds once: pictures, and unscattered light in voxels."""

import copy
import pickle

import mcrt
import numpy as np
import pytest
from comparing import relative_rms
from conftest import camera, interrupted, run

pytestmark = pytest.mark.cpu_only("what is found when, and kept, is the host's to say")

OTHER = camera((0.0, -30.0, 60.0), (9, 8))
SUN = mcrt.DirectionalLight((-0.4, 0.1, -1.0), 2.0)


@pytest.fixture
def calls(monkeypatch):
    """The calls of the core by name, from now on."""
    made = []

    def count(name):
        core = getattr(mcrt._mcrt, name)

        def counted(*arguments):
            made.append(name)
            return core(*arguments)

        monkeypatch.setattr(mcrt._mcrt, name, counted)

    for name in ("Scene", "gather", "unscattered"):
        count(name)
    return made


def look(result, path, view=None):
    """All that shows the picture of a camera."""
    result.image(view)
    result.image(view, 1)
    result.image_error(view)
    result.alpha(view)
    result.save_png(path, view)
    result.plot_image(view)


def read(result):
    """All that is read from voxels."""
    names = ("fluence", "fluence_error", "radiance", "radiance_error", "absorbed", "absorbed_error")
    return {name: getattr(result, name).copy() for name in names}


def test_pictures_find_no_unscattered_light_in_voxels_and_voxels_no_picture(calls, tmp_path):
    result = run()
    look(result, tmp_path / "own.png")
    look(result, tmp_path / "other.png", OTHER)
    result._repr_html_()
    assert "unscattered" not in calls
    del calls[:]
    read(result)
    result.plot_slice("absorbed")
    result.save(tmp_path / "result.npz")
    result + run(seed=1)
    assert calls.count("unscattered") == 2  # of this one, and of that which was added
    assert "gather" not in calls


def test_each_picture_is_gathered_once_and_its_replicates_once(calls, tmp_path):
    result = run()
    assert calls == ["Scene"]
    for view in (None, OTHER):
        del calls[:]
        look(result, tmp_path / "picture.png", view)
        look(result, tmp_path / "picture.png", view)
        result.save_exr(tmp_path / "picture.exr", view)
        assert calls == ["gather", "gather"]
    str(result), result._repr_html_(), result.to_xarray()
    assert calls == ["gather", "gather", "unscattered"]


def test_a_run_by_its_pixels_keeps_its_picture(calls, tmp_path):
    result = run(photons=None, target_error=0.2)
    assert result.stats.stopped_by == "target_error"
    assert result.stats.seconds["picture"] > 0.0
    del calls[:]
    look(result, tmp_path / "picture.png")
    result._repr_html_()
    assert calls == []


def test_a_run_by_its_voxels_hands_over_their_unscattered_light(calls):
    result = run(photons=None, target_error=0.5, camera=None)
    found = mcrt._mcrt.unscattered(result._core, result._settings)
    del calls[:]
    handed = result._data["unscattered"]
    for name in ("fluence", "radiance"):
        np.testing.assert_array_equal(found[name], handed[name])
    tallied = result._data["fluence"].copy()
    np.testing.assert_array_equal(result.fluence, tallied + found["fluence"])
    assert calls == []


@pytest.mark.parametrize(
    "light", [None, SUN, mcrt.PencilBeam((11.5, -17.5, 50.0), (0, 0, -1), 3.0)]
)
@pytest.mark.parametrize("method", ["single", "photon"])
def test_unscattered_light_is_there_whatever_is_read_first(method, light, tmp_path):
    def again():
        options = {"light": light} if light else {}
        return run(method=method, albedo=(0.9, 0.6, 0.3), photons=2000, **options)

    result = again()
    energy = result.energy
    values = read(result)
    assert values["fluence"].any()
    other = again()
    assert read(other)["fluence"].tobytes() == values["fluence"].tobytes()
    loaded, empty = again(), again()
    loaded.save(tmp_path / "result.npz")
    copies = [
        mcrt.Result.load(tmp_path / "result.npz"),
        pickle.loads(pickle.dumps(result)),
        pickle.loads(pickle.dumps(empty)),
        copy.deepcopy(empty),
        copy.copy(empty),
    ]
    for one in (other, *copies):
        for name, array in read(one).items():
            np.testing.assert_array_equal(array, values[name], err_msg=name)
        for name in ("unscattered", "absorbed", "truncated", "error", "launched"):
            np.testing.assert_array_equal(one.energy[name], energy[name], err_msg=name)
        np.testing.assert_array_equal(one.image(), result.image())


def test_a_failure_to_find_unscattered_light_is_told_and_not_kept(monkeypatch):
    result = run()
    expected = run().fluence

    def fail(*arguments):
        raise mcrt.DeviceLostError("the GPU was lost")

    with monkeypatch.context() as patch:
        patch.setattr(mcrt._mcrt, "unscattered", fail)
        for name in ("fluence", "fluence_error", "absorbed", "radiance"):
            with pytest.raises(mcrt.DeviceLostError, match="lost"):
                getattr(result, name)
        result.image()
    np.testing.assert_array_equal(result.fluence, expected)


@pytest.mark.cpu_only("it waits for rays of the processor")
def test_ctrl_c_stops_the_search_for_unscattered_light():
    volume = np.random.default_rng(1).random((96, 96, 96), dtype=np.float32)
    result = mcrt.simulate(
        volume, extinction=2.0, light=SUN, photons=1000, method="photon", threads=1, progress=False
    )
    assert interrupted(lambda: result.fluence, 0.2) < 1.0
    assert not result._data["order0"]


@pytest.mark.cpu_only("the GPU takes light rays for all samples")
def test_large_pictures_interpolate_light_between_fine_nodes():
    light = mcrt.PointLight((100, -75, 150), intensity=1e5)
    eye = mcrt.PerspectiveCamera((125, -100, 55), (24, 24, 22), fov=16, resolution=(160, 160))
    result = mcrt.simulate(
        mcrt.datasets.cloud(48), extinction=0.2, light=light, camera=eye, method="single"
    )
    assert "two nodes per voxel" in " ".join(str(result.plan).split())
    between = result.image()
    rays = copy.copy(result)
    rays._data, rays._layers = result._data | {"fine": [False]}, {}
    exact = rays.image()
    # .28 % and .012 %: second order in the half of a voxel between nodes.
    assert 0.0 < relative_rms(between, exact) < 0.003
    assert abs(between.mean() / exact.mean() - 1.0) < 3e-4
    small = mcrt.PerspectiveCamera((125, -100, 55), (24, 24, 22), fov=16, resolution=(8, 8))
    np.testing.assert_array_equal(result.image(small), rays.image(small))
