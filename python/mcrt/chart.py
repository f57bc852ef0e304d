"""Speed against accuracy: each method's error over its seconds, on one small cloud."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import datasets, display
from ._scene import PerspectiveCamera, PointLight
from ._simulate import simulate

PHOTONS = (1e4, 3e4, 1e5, 3e5, 1e6)
PATHS = (4, 16, 64, 256)  # per pixel
TRACKERS = ("woodcock", "march")
FINER = 3


class Point(NamedTuple):
    """A run: how it was made (photons, or paths per pixel), its seconds, its relative error."""

    method: str
    tracker: str
    samples: float
    seconds: float
    error: float


def chart(
    path: Path,
    *,
    side: int = 48,
    resolution: int = 96,
    photons: Sequence[float] = PHOTONS,
    paths: Sequence[float] = PATHS,
    reference_photons: float = 5e6,
    seed: int = 0,
) -> list[Point]:
    """Run every method, print their seconds and errors, draw them to `path`.

    The error is the RMS difference from a converged reference (its noise taken off) over the mean,
    over the pixels above 5 % of the maximum. The reference is the same medium on voxels three
    times finer, so that the bias by the size of a voxel is part of the error, nine parts of ten.

    Parameters
    ----------
    path : Path
        The picture to write; its ending says the format.
    side : int
        Voxels along each axis of the cloud.
    resolution : int
        Pixels along each axis of the image.
    photons : sequence of float
        Photons of the runs of method "photon".
    paths : sequence of float
        Paths per pixel of the runs of method "path".
    reference_photons : float
        Photons of the reference.
    seed : int
        The reference takes the next one.

    Returns
    -------
    list of Point
    """
    axes = display._axes(None)  # first: without matplotlib nothing is run
    density = datasets.cloud(side)
    scene = _scene(side, resolution)
    finer_scene = scene | {"spacing": 1.0 / FINER, "seed": seed + 1}
    reference = simulate(
        finer(density, FINER), method="photon", photons=reference_photons, **finer_scene
    )
    truth = reference.image(), reference.image_error()
    ways: list[tuple[str, str, float | None]] = [("single", "auto", None)]
    ways += [("photon", tracker, count) for tracker in TRACKERS for count in photons]
    ways += [("path", "auto", count) for count in paths]
    print(f"{'method':<8} {'tracker':<9} {'samples':>8} {'seconds':>8} {'error':>8}")
    points = []
    for method, tracker, count in ways:
        start = time.perf_counter()
        samples: dict[str, Any] = {"spp" if method == "path" else "photons": count}
        image = simulate(
            density, method=method, tracker=tracker, seed=seed, **samples, **scene
        ).image()
        seconds = time.perf_counter() - start
        point = Point(method, tracker, count or 0.0, seconds, relative_error(image, *truth))
        points.append(point)
        way = f"{method:<8} {tracker:<9} {point.samples:>8.0e}" if count else f"{method:<27}"
        print(f"{way} {seconds:>8.3f} {point.error:>8.2%}", flush=True)
    _draw(axes, points)
    axes.set_title(f"cloud of {side}³ voxels, {resolution} x {resolution} pixels")
    axes.figure.savefig(path, dpi=150)
    print(f"wrote {path}")
    return points


def finer(density: np.ndarray, factor: int) -> np.ndarray:
    """The same field on voxels `factor` times finer, for linear interpolation.

    `factor` is odd: the old voxel centres are then among the new ones, and the field is linear
    along each axis between them.
    """
    for axis, n in enumerate(density.shape):
        at = np.clip((np.arange(factor * n) + 0.5) / factor - 0.5, 0.0, n - 1.0)
        low = np.minimum(at.astype(int), max(n - 2, 0))
        shape = [1, 1, 1]
        shape[axis] = -1
        t = (at - low).reshape(shape).astype(np.float32)
        high = np.minimum(low + 1, n - 1)
        density = (1 - t) * density.take(low, axis) + t * density.take(high, axis)
    return density


def relative_error(image: np.ndarray, reference: np.ndarray, noise: np.ndarray) -> float:
    """RMS difference beyond the reference's noise over the mean, above 5 % of the maximum."""
    bright = reference > 0.05 * reference.max()
    square = np.mean((image - reference)[bright] ** 2) - np.mean(noise[bright] ** 2)
    return float(np.sqrt(max(square, 0.0)) / reference[bright].mean())


def _scene(side: int, resolution: int) -> dict[str, Any]:
    """The cloud's optical depth and albedo, its light and camera, whatever its voxels."""
    x, y, z = 1.5 * side, -1.2 * side, 2.3 * side
    target = (side / 2, side / 2, 0.45 * side)
    return {
        "extinction": 4.0 / side,
        "albedo": 0.9,
        "light": PointLight((x, y, z), intensity=side**2),
        "camera": PerspectiveCamera(
            (2.6 * side, -2.1 * side, 1.15 * side), target, fov=20.0, resolution=(resolution,) * 2
        ),
        "outputs": ["image"],
        "progress": False,
    }


def _draw(axes: Any, points: list[Point]) -> None:
    """Error over seconds, logarithmic, a line for each way."""
    for way in dict.fromkeys(point[:2] for point in points):
        line = [point for point in points if point[:2] == way]
        name = way[0] if way[1] == "auto" else f"{way[0]}, {way[1]}"
        seconds, errors = [p.seconds for p in line], [100.0 * p.error for p in line]
        axes.loglog(seconds, errors, "*" if len(line) == 1 else "o-", markersize=8, label=name)
    for axis in (axes.xaxis, axes.yaxis):
        axis.get_major_locator().set_params(subs=(1.0, 2.0, 5.0))
        axis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set(xlabel="seconds", ylabel="relative RMS error [%]")
    axes.grid(alpha=0.3)
    axes.legend()
