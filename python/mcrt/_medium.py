"""The medium: a density array and what scatters in it."""

from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._arguments import (
    Value,
    channels,
    choice,
    describe,
    first_index,
    numeric,
    positive,
    rgb,
    single,
    vector,
    volume,
    wrong,
)
from ._errors import SceneError
from ._scene import Phase, as_phase


@dataclass(frozen=True, eq=False, repr=False)
class Medium:
    """A box of voxels that absorbs, scatters and emits; vacuum outside.

    sigma_t = extinction * density [1/length], sigma_s = albedo * sigma_t. Voxel (k, j, i) covers
    origin + ((i..i+1) dx, (j..j+1) dy, (k..k+1) dz).

    Parameters
    ----------
    density : array (nz, ny, nx)
        Real numbers of any dtype and memory layout, not negative; integers are used as they are
        (255 means 255). One float32 copy is made.
    spacing : float or (dz, dy, dx)
        Size of a voxel, in the order of the array's axes.
    origin : (x, y, z)
        Lower corner of the box.
    interpolation : "linear" or "nearest"
        Samples at voxel centres, clamped at the border; or constant in each voxel.
    extinction : float or RGB
        Extinction coefficient at density 1 [1/length].
    albedo : float, RGB, or array (nz, ny, nx)
        Single-scattering albedo, 0 to 1. Three numbers are RGB; only 3-D arrays are per voxel.
    phase : phase function, optional
        `Isotropic()` if None.
    emission : float, RGB, or array (nz, ny, nx) or (nz, ny, nx, 3), optional
        Source term L_e: the radiance that a unit of length adds [W/(sr length^3)], not multiplied
        by the absorption coefficient; interpolated as the density is, and there where that is zero
        too. A medium in thermal equilibrium has sigma_a times Planck's radiance. It emits
        4 pi times the volume integral of L_e [W].

    Raises
    ------
    SceneError
        If an argument is not of these types and shapes.
    VolumeTooLargeError
        If there is no memory for the copy.
    """

    density: np.ndarray
    _: KW_ONLY
    spacing: float | tuple[float, float, float] = 1.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    interpolation: str = "linear"
    extinction: Value = 1.0
    albedo: Value | np.ndarray = 0.9
    phase: Phase | None = None
    emission: Value | np.ndarray | None = None
    shape: str = field(default="voxels", init=False)

    def __post_init__(self) -> None:
        density = volume("density", self.density)
        normalised = {
            "density": density,
            "spacing": _spacing(self.spacing),
            "origin": vector("origin", self.origin),
            "interpolation": choice("interpolation", self.interpolation, ("nearest", "linear")),
            "extinction": rgb("extinction", self.extinction),
            "albedo": _albedo(self.albedo, density.shape),
            "phase": as_phase(self.phase),
            "emission": _emission(self.emission, density.shape),
        }
        for name, value in normalised.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_opacity(cls, alpha: ArrayLike, step: float, **arguments: Any) -> "Medium":
        """A medium whose voxels let 1 - alpha of the light through per step.

        alpha = 1 - exp(-sigma_t step), hence sigma_t = -log(1 - alpha) / step.

        Parameters
        ----------
        alpha : array (nz, ny, nx)
            Opacity per step, 0 <= alpha < 1 (as in volume rendering).
        step : float
            Length that the opacity is meant for, often the size of a voxel.
        **arguments
            As for `Medium`; the extinction stays 1.

        Raises
        ------
        SceneError
            If an alpha is outside [0, 1) (its index is given), or `extinction` is given.
        """
        if "extinction" in arguments:
            raise SceneError("extinction must not be given: the opacity and the step determine it")
        step = positive("step", step)
        expected = "a 3-D array (nz, ny, nx) of opacities in [0, 1)"
        array = numeric("alpha", alpha, expected).astype(np.float64)
        outside = ~((array >= 0.0) & (array < 1.0))
        if outside.any():
            where = first_index(outside)
            raise SceneError(
                f"alpha must be {expected}; {np.count_nonzero(outside)} values of "
                f"{describe(array)} are not, the first is {array[where]} at index {where}"
            )
        return cls(np.abs(np.log1p(-array)) / step, **arguments)

    @classmethod
    def box(cls, size: ArrayLike, *, origin: ArrayLike = (0, 0, 0), **arguments: Any) -> "Medium":
        """A homogeneous box without voxels.

        Its images come from method "path". With `outputs` that name voxel quantities it counts as
        one voxel, whose means method "photon" gives.

        Parameters
        ----------
        size : float or (x, y, z)
            Lengths of its edges.
        origin : (x, y, z)
            Its lower corner.
        **arguments
            `extinction`, `albedo`, `phase`, `emission` (a number or RGB), as for `Medium`.
        """
        edges = numeric("size", size, "a number or 3 numbers (x, y, z)")
        if edges.shape not in ((), (3,)) or not ((edges > 0) & np.isfinite(edges)).all():
            raise wrong("size", "a positive number or 3 (x, y, z)", size)
        corner = vector("origin", origin)
        return cls._solid("box", tuple(np.broadcast_to(edges, 3)[::-1]), corner, arguments)

    @classmethod
    def sphere(cls, radius: float, *, center: ArrayLike = (0, 0, 0), **arguments: Any) -> "Medium":
        """A homogeneous sphere without voxels; its images come from method "path".

        Parameters
        ----------
        radius : float
        center : (x, y, z)
        **arguments
            `extinction`, `albedo`, `phase`, `emission` (a number or RGB), as for `Medium`.
        """
        radius = positive("radius", radius)
        middle = np.array(vector("center", center))
        if not np.isfinite(middle).all():
            raise wrong("center", "3 finite numbers (x, y, z)", center)
        corner = vector("center", middle - radius)
        return cls._solid("sphere", 2.0 * radius, corner, arguments)

    @classmethod
    def _solid(cls, shape: str, spacing: Any, origin: Any, arguments: Any) -> "Medium":
        """One voxel that stands for a solid."""
        for name in ("spacing", "interpolation", "density"):
            if name in arguments:
                raise SceneError(f"{name} is not for a {shape}, which has no voxels")
        one = np.ones((1, 1, 1), np.float32)
        medium = cls(one, spacing=spacing, origin=origin, interpolation="nearest", **arguments)
        object.__setattr__(medium, "shape", shape)
        return medium

    def __repr__(self) -> str:
        if self.shape != "voxels":
            return f"<mcrt.Medium, homogeneous {self.shape}, {self.phase}>"
        return (
            f"<mcrt.Medium {' x '.join(map(str, self.density.shape))} voxels (z, y, x), "
            f"{self.interpolation}, {self.phase}>"
        )


def _spacing(value: Any) -> tuple[float, float, float]:
    """A number or (dz, dy, dx) as (dz, dy, dx)."""
    expected = "a number or 3 numbers (dz, dy, dx)"
    array = numeric("spacing", value, expected)
    if array.shape not in ((), (3,)):
        raise wrong("spacing", expected, value)
    return vector("spacing", np.broadcast_to(array, 3))


def _albedo(value: Any, shape: tuple[int, ...]) -> Value | np.ndarray:
    """A number, RGB, or an array with one albedo per voxel."""
    expected = f"a number, 3 numbers (RGB), or an array of the density's shape {shape}"
    array = numeric("albedo", value, expected)
    if array.ndim == 3 and array.shape == shape:
        return volume("albedo", array)
    if array.shape in ((), (3,)):
        return rgb("albedo", array)
    raise wrong("albedo", expected, value)


def _emission(value: Any, shape: tuple[int, ...]) -> Value | np.ndarray | None:
    """None, a number, RGB, or an array with one source term (or three) per voxel."""
    if value is None:
        return None
    rgb_shape = (*shape, 3)
    expected = f"a number, 3 numbers (RGB), or an array of the shape {shape} or {rgb_shape}"
    array = numeric("emission", value, expected)
    if array.shape == shape:
        return single("emission", array, "(k, j, i)")
    if array.shape == rgb_shape:
        return single("emission", array, "(k, j, i, channel)")
    if array.shape in ((), (3,)):
        return rgb("emission", array)
    raise wrong("emission", expected, value)


def emission_planes(medium: Medium) -> np.ndarray | None:
    """The emission that the Rust core takes: float32 (1 or 3, nz, ny, nx)."""
    emission, shape = medium.emission, medium.density.shape
    if emission is None:
        return None
    if isinstance(emission, np.ndarray):
        planes = emission[np.newaxis] if emission.ndim == 3 else np.moveaxis(emission, -1, 0)
    else:
        values = single("emission", np.array(channels(emission)), "channel")
        planes = np.broadcast_to(
            values[:, np.newaxis, np.newaxis, np.newaxis], (len(values), *shape)
        )
    return np.ascontiguousarray(planes)
