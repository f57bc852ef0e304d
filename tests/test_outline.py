"""Pixels that the medium covers in part, against the area of its outline. Deterministic: no false
alarms.

The truth is the convex hull of the box's projected corners, cut into thin strips along x whose ends
are exact. An opaque box has alpha equal to the covered part of the pixel; one seen straight from
above has one radiance wherever it is seen.
"""

import mcrt
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from truth import View

SHAPE, SIZE, CENTRE = (4, 5, 6), (6.0, 5.0, 4.0), np.array([3.0, 2.5, 2.0])
RESOLUTION, STRIPS = (24, 20), 400


def covered(view, size=SIZE):
    """The part of each pixel within the outline of the box."""
    w, h = view.resolution
    corners = np.indices((2, 2, 2)).reshape(3, 8).T * np.array(size)
    points = np.array([view.project(corner) for corner in corners])
    hull = points[ConvexHull(points).vertices]
    y = (np.arange(h * STRIPS) + 0.5) / STRIPS
    (x0, y0), (x1, y1) = hull.T, np.roll(hull, -1, 0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (y[:, None] - y0) / (y1 - y0)
    x = np.where((part >= 0) & (part <= 1), x0 + part * (x1 - x0), np.nan)
    low = np.where(np.isnan(x), np.inf, x).min(1)[:, None]
    high = np.where(np.isnan(x), -np.inf, x).max(1)[:, None]
    column = np.arange(w)
    length = np.clip(np.minimum(high, column + 1) - np.maximum(low, column), 0, None)
    return length.reshape(h, STRIPS, w).mean(1)


def seen(view, extinction, shape=SHAPE, **options):
    arguments = {
        "extinction": extinction,
        "interpolation": "nearest",
        "light": mcrt.DirectionalLight((0, 0, -1), 1.0),
        "camera": view.camera(),
        "method": "single",
        "outputs": ("image",),
        "progress": False,
    }
    return mcrt.simulate(np.ones(shape, np.float32), **(arguments | options))


def from_above(angle, aside, width):
    """Straight down, turned by `angle`, aside by parts of the width."""
    x, y = CENTRE[:2] + np.array(aside) * width / RESOLUTION[0]
    up = (np.sin(np.radians(angle)), np.cos(np.radians(angle)), 0)
    return View((x, y, 30.0), (x, y, 0.0), RESOLUTION, width=width, up=up)


def test_edges_along_rows_and_columns_are_covered_exactly():
    # A grid of 8 x 8 points errs by 6 % of a pixel, all along an edge.
    for width, aside in [(8.0, (0.11, 0.37)), (9.3, (0.5, -0.06)), (11.0, (-0.03, 0.06))]:
        view = from_above(0, aside, width)
        truth, result = covered(view), seen(view, 20.0)
        assert np.abs(result.alpha() - truth).max() < 2e-3, (width, aside)
        image = result.image() / np.median(result.image()[truth > 0.9999])
        assert np.abs(image - truth).max() < 3e-3, (width, aside)


@pytest.mark.parametrize("seed", range(4))
def test_edges_at_any_angle_are_covered(seed):
    rng = np.random.default_rng(seed)
    views = [
        from_above(rng.uniform(0, 90), rng.uniform(-0.5, 0.5, 2), rng.uniform(9, 14)),
        View(
            tuple(CENTRE + rng.normal(size=3) * 3 + (0, 0, 18)),
            tuple(CENTRE),
            RESOLUTION,
            fov=rng.uniform(40, 50),
            up=(0.3, 1, 0.2),
        ),
    ]
    for view in views:
        truth, alpha = covered(view), seen(view, 1e6).alpha()
        partly = (truth > 0) & (truth < 1)
        assert partly.sum() > 15
        # The truth's strips are exact to half of one: 1 / 800 of a pixel.
        assert np.abs(alpha - truth).max() < 2e-3, view
        assert abs((alpha - truth)[partly].sum()) < 3e-3 * truth[partly].sum(), view


SIZES = [0.8, 0.3, 0.1, 0.05]


def opacity(size, x, y):
    """That of a box smaller than a pixel, so far from a corner of a pixel, and the part covered."""
    view = View((3 - x, 3 - y, 9.0), (3 - x, 3 - y, 0.0), (6, 6), width=6.0, up=(0, 1, 0))
    return seen(view, 1e4, (1, 1, 1), spacing=size).alpha(), covered(view, (size,) * 3)


@pytest.mark.parametrize("size", SIZES)
def test_boxes_smaller_than_a_pixel_are_seen(size):
    # Neither a corner of a pixel nor its middle meets them.
    for x, y, bound in [(0.21, 0.2, 1e-4), (0.6, 0.15, 3e-3), (1.0, 0.4, 1e-4), (0.97, 0.99, 1e-2)]:
        alpha, truth = opacity(size, x, y)
        assert np.abs(alpha - truth).max() < bound, (x, y)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "place",
    [(0.21, 0.2), (0.6, 0.15), (1.0, 0.4), (0.97, 0.99)],
)
def test_boxes_smaller_than_a_pixel_are_as_opaque_as_they_are_large(place, size):
    # Bounds on pixels are wider than the smallest box: here 1 % of the box is what may be lost, and
    # what single precision rounds of the sum of a pixel's thousand rays, 1e-5.
    alpha, _ = opacity(size, *place)
    assert abs(alpha.sum(dtype=float) - size**2) < 1e-2 * size**2 + 2e-5


def test_photons_and_colours_take_the_same_outline():
    view = from_above(0, (0.11, 0.37), 8.0)
    truth = covered(view)
    result = seen(view, (20.0, 30.0, 40.0), method="photon", photons=2000)
    assert np.abs(result.alpha() - truth[..., None]).max() < 2e-3
    order1 = result.image(order=1)
    order1 /= np.median(order1[truth > 0.9999], axis=0)
    assert np.abs(order1 - truth[..., None]).max() < 3e-3


def test_the_sky_is_seen_past_the_outline():
    view = from_above(20, (0.11, 0.37), 8.0)
    result = seen(view, 1e4, light=mcrt.EnvironmentLight(2.0), albedo=0.0)
    assert np.abs(result.image(order=0) - 2.0 * (1 - result.alpha())).max() < 1e-5
