"""The choices of `auto`, on both sides of where each changes.

Nothing is run but plans, and nothing depends on chance. Where a choice changes is computed here by
hand from the scene, not read from the plan.
"""

import mcrt
import numpy as np
import pytest

pytestmark = pytest.mark.cpu_only("plans are the host's")

N = 12
EYE = mcrt.PerspectiveCamera((60, -40, 30), (6, 6, 6), fov=15, resolution=(64, 64))


def plan(volume=None, **options):
    defaults = {
        "extinction": 0.05,
        "light": mcrt.DirectionalLight((0.4, -0.5, -0.8)),
        "camera": EYE,
    }
    return mcrt.plan(smooth() if volume is None else volume, **(defaults | options))


def smooth(n=N):
    """A blob that interpolation follows."""
    z, y, x = (np.indices((n, n, n)) + 0.5) / n - 0.5
    return np.exp(-8 * (x * x + 0.8 * y * y + 1.2 * z * z)).astype(np.float32)


def rough():
    """Voxels that know nothing of each other."""
    return np.random.default_rng(3).gamma(1.0, 1.0, (N, N, N)).astype(np.float32)


def choice(plan, name):
    return next(what for key, what, _ in plan.decisions if key == name)


@pytest.mark.parametrize("albedo", [0.5, 1.0])
@pytest.mark.parametrize("target", [0.02, 0.1])
def test_single_is_taken_where_order_2_is_below_half_the_target(target, albedo):
    """An order is at most albedo (1 - exp(-tau)) of the one before, tau the diagonal's."""
    volume = np.ones((N, N, N), np.float32)
    again = 0.5 * target / (1 + 0.5 * target)  # whose geometric series is half the target
    extinction = -np.log1p(-again / albedo) / (N * np.sqrt(3))

    def method(factor, **options):
        return plan(volume, extinction=factor * extinction, albedo=albedo, **options).method

    assert method(0.97, target_error=target) == "single"
    assert method(1.03, target_error=target) == "photon"
    assert method(0.97, target_error=target, photons=1000) == "single"
    assert method(0.001) == "single"
    assert method(0.97, photons=1000) == "photon"
    assert method(0.97, target_error=target, max_scatterings=0) == "photon"


def spikes(part):
    """Voxels of density 1, exactly this part of all, in a void."""
    density = np.zeros(16**3, np.float32)
    density[: round(part * 16**3)] = 1.0
    return np.random.default_rng(6).permutation(density).reshape(16, 16, 16)


@pytest.mark.parametrize("walk", ["lanes", "one by one"])
def test_march_is_taken_where_null_collisions_cost_more(walk, monkeypatch):
    """A tenth of all voxels has a depth of tau, each in a cell of its own.

    Steps cost 1.5 a voxel for the cells and 1 (one by one: 3) for each tentative collision, of
    which there are .3 in an empty voxel if lanes score at them; marching costs 2.
    """
    part, each, least = (0.1, 1.0, 0.3) if walk == "lanes" else (0.1, 3.0, 0.0)
    if walk == "one by one":
        monkeypatch.setenv("MCRT_SIMD", "scalar")
    tau = ((2.0 - 1.5) / each - least * (1 - part)) / part

    def tracker(factor, **options):
        return plan(
            spikes(part), extinction=factor * tau, interpolation="nearest", **options
        ).tracker

    assert tracker(0.95) == "woodcock"
    assert tracker(1.05) == "march"
    assert tracker(1.05, tracker="woodcock") == "woodcock"
    # Between voxel centres marching costs six times as much.
    assert plan(spikes(part), extinction=1.05 * tau, interpolation="linear").tracker == "woodcock"


def test_one_majorant_is_taken_where_it_is_close_to_the_medium():
    flat = 1 - 0.01 * np.random.default_rng(2).random((N, N, N), dtype=np.float32)
    assert "one majorant" in str(plan(flat, extinction=0.2))
    assert "cells of" in str(plan(spikes(0.001), extinction=2.0))


def test_the_analytic_tracker_is_for_homogeneous_media():
    even = np.ones((N, N, N), np.float32)
    assert plan(even).tracker == "analytic"
    assert plan(even, extinction=(0.05, 0.06, 0.07)).tracker == "woodcock"
    even[3, 4, 5] += 1e-6
    assert plan(even).tracker == "woodcock"


@pytest.mark.parametrize(("volume", "grid"), [(smooth(32), True), (rough(), False)])
def test_the_light_grid_is_interpolated_where_the_medium_is_smooth(volume, grid):
    what = "from the light grid" if grid else "by light rays"
    assert what in choice(plan(volume, extinction=0.2), "light")


def test_photons_start_at_first_collisions_in_voxels_up_to_a_mean_free_path():
    for extinction, where in ((0.97, "first collision"), (1.03, "at the light")):
        even = plan(np.ones((N, N, N), np.float32), extinction=extinction)
        assert f"photons start at {'their ' if 'first' in where else ''}" in choice(even, "light")
        assert where in choice(even, "light")


def test_near_lights_are_those_within_a_quarter_of_the_shortest_side():
    for away, near in ((0.24, True), (0.26, False)):
        lamp = mcrt.PointLight((6, 6, -away * 8.0))
        box = np.ones((8, N, N), np.float32)
        how = choice(plan(box, light=lamp, method="path", outputs=("image",)), "light")
        assert ("in the medium or next to it" in how) == near


def test_paths_fly_to_first_collisions_where_the_view_is_opaque():
    """A wide slab seen from above: 1 - exp(-tau) is .6 at tau .916."""
    above = mcrt.OrthographicCamera((6, 6, 30), (6, 6, 0), (0, 1, 0), 1.0, (16, 16))
    for factor, how in ((0.95, "drawn from a walk"), (1.05, "flown to")):
        slab = np.ones((N, N, N), np.float32)
        told = plan(
            slab,
            extinction=factor * -np.log(0.4) / N,
            camera=above,
            method="path",
            outputs=("image",),
        )
        assert how in choice(told, "first collisions")


def test_samples_per_pixel_and_spheres_ask_for_paths():
    assert plan(extinction=0.5).method == "photon"
    assert plan(extinction=0.5, spp=16, outputs=("image",)).method == "path"
    ball = mcrt.Medium.sphere(3.0, extinction=0.5)
    assert mcrt.plan(ball, outputs=("image",)).method == "path"


def test_many_voxels_have_fewer_sub_volumes():
    """16 replicates of a million values, 8 of more."""
    for shape, count in (((64, 128, 128), 16), ((65, 128, 128), 8)):
        even = np.ones(shape, np.float32)
        assert plan(even, extinction=0.01, photons=1e6).subvolumes == count
    assert plan(smooth(), errors=False, method="photon").subvolumes == 0
