"""The medium: a density array and what scatters in it."""

from __future__ import annotations

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
from ._labels import Frame, as_labelled, read
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
        (255 means 255). One float32 copy is made. The axes of an `xarray.DataArray` are known by
        their names, in any order: x, y, and z, height, altitude, lev or level; see the notes.
    spacing : float or (dz, dy, dx), optional
        Size of a voxel, in the order of the array's axes; None is 1, or what coordinates say.
    origin : (x, y, z), optional
        Lower corner of the box; None is (0, 0, 0), or what coordinates say.
    interpolation : "linear" or "nearest"
        Samples at voxel centres, clamped at the border; or constant in each voxel.
    extinction : float or RGB, optional
        Extinction coefficient at density 1 [1/length]; None is 1.
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
        If an argument is not of these types and shapes, has a unit (of astropy, pint, ...) or a
        masked value.
    VolumeTooLargeError
        If there is no memory for the copy.

    Notes
    -----
    The coordinates of an `xarray.DataArray` are the voxels' centres: spacing and origin follow from
    them, and what they say must not be contradicted. They are even within a thousandth of a voxel
    (or the rounding of their dtype); descending ones are flipped, so that all arrays of the result
    are (z, y, x), ascending. Without coordinates the names alone count. Names that mean no length
    (lat, lon, depth, time) and uneven coordinates are errors that say how to resample. An albedo or
    emission per voxel may be a DataArray too, and must be one where the density was turned.
    """

    density: np.ndarray
    _: KW_ONLY
    spacing: float | tuple[float, float, float] | None = None
    origin: tuple[float, float, float] | None = None
    interpolation: str = "linear"
    extinction: Value | None = None
    albedo: Value | np.ndarray = 0.9
    phase: Phase | None = None
    emission: Value | np.ndarray | None = None
    shape: str = field(default="voxels", init=False)
    frame: Frame | None = field(default=None, init=False)  # of an xarray.DataArray
    remarks: dict[str, list[Any]] = field(default_factory=dict, init=False)  # for the plan

    def __post_init__(self) -> None:
        labelled = as_labelled(self.density)
        given, frame = (self.density, Frame()) if labelled is None else read("density", labelled)
        density = volume("density", given)
        spacing, origin = frame.placed(
            None if self.spacing is None else _spacing(self.spacing),
            None if self.origin is None else vector("origin", self.origin),
        )
        per_voxel = {}
        for name, parse in (("albedo", _albedo), ("emission", _emission)):
            value = getattr(self, name)
            laid_out = _laid_out(name, value, frame, spacing, origin)
            per_voxel[name] = parse(laid_out, density.shape)
            _refuse_turned(name, value, per_voxel[name], frame)
        normalised = {
            **per_voxel,
            "density": density,
            "spacing": spacing,
            "origin": origin,
            "interpolation": choice("interpolation", self.interpolation, ("nearest", "linear")),
            "extinction": 1.0 if self.extinction is None else rgb("extinction", self.extinction),
            "phase": as_phase(self.phase),
            "frame": None if labelled is None else frame,
            "remarks": {
                "decisions": [] if labelled is None else [frame.row(spacing, origin)],
                "warnings": _opaque(density, spacing) if self.extinction is None else [],
            },
        }
        for name, value in normalised.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_opacity(cls, alpha: ArrayLike, step: float, **arguments: Any) -> Medium:
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
        labelled = as_labelled(alpha)
        values = alpha if labelled is None else labelled.data
        array = numeric("alpha", values, expected).astype(np.float64)
        outside = ~((array >= 0.0) & (array < 1.0))
        if outside.any():
            where = first_index(outside)
            raise SceneError(
                f"alpha must be {expected}; {np.count_nonzero(outside)} values of "
                f"{describe(array)} are not, the first is {array[where]} at index {where}"
            )
        sigma_t = np.abs(np.log1p(-array)) / step
        density = sigma_t if labelled is None else labelled.copy(data=sigma_t)
        return cls(density, extinction=1.0, **arguments)

    @classmethod
    def box(cls, size: ArrayLike, *, origin: ArrayLike = (0, 0, 0), **arguments: Any) -> Medium:
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
    def sphere(cls, radius: float, *, center: ArrayLike = (0, 0, 0), **arguments: Any) -> Medium:
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
    def _solid(cls, shape: str, spacing: Any, origin: Any, arguments: Any) -> Medium:
        """One voxel that stands for a solid."""
        for name in ("spacing", "interpolation", "density"):
            if name in arguments:
                raise SceneError(f"{name} is not for a {shape}, which has no voxels")
        one = np.ones((1, 1, 1), np.float32)
        voxel = {"spacing": spacing, "origin": origin, "interpolation": "nearest"}
        medium = cls(one, **({"extinction": 1.0} | arguments | voxel))
        object.__setattr__(medium, "shape", shape)
        return medium

    def __repr__(self) -> str:
        if self.shape != "voxels":
            return f"<mcrt.Medium, homogeneous {self.shape}, {self.phase}>"
        return (
            f"<mcrt.Medium {' x '.join(map(str, self.density.shape))} voxels (z, y, x), "
            f"{self.interpolation}, {self.phase}>"
        )


OPAQUE = 20.0  # optical depth of a voxel, of which exp(-20) = 2e-9 of the light gets through


def _opaque(density: np.ndarray, spacing: tuple[float, float, float]) -> list[str]:
    """A warning where the extinction was left at 1 and light does not even cross a voxel."""
    largest, step = float(density.max()), max(spacing)
    if not largest * step > OPAQUE:
        return []
    return [
        f"extinction is not given and counts as 1 per unit of density and length: the largest "
        f"density, {largest:.6g}, then has an optical depth of {largest * step:.3g} in one voxel "
        f"(spacing {step:.6g}), which no light crosses. If densities are grey values or counts, "
        f"pass extinction: {0.1 / (largest * step):.2g} makes it 0.1 a voxel"
    ]


def _laid_out(name: str, value: Any, frame: Frame, spacing: Any, origin: Any) -> Any:
    """What a DataArray holds per voxel, laid out as the density is; others as they are."""
    labelled = as_labelled(value)
    if labelled is None or labelled.ndim < 3:
        return value
    values, own = read(name, labelled)
    if not own.agrees(frame, spacing, origin):
        raise SceneError(
            f"{name} must have the coordinates of the density: spacing {spacing} (dz, dy, dx) and "
            f"origin {origin} (x, y, z)"
        )
    if own.coordinates is None and frame.flipped:
        raise SceneError(
            f"{name} has no coordinates, and {', '.join(frame.flipped)} of the density descends: "
            "give it the density's coordinates"
        )
    return values


def _refuse_turned(name: str, given: Any, found: Any, frame: Frame) -> None:
    """An array without names does not say in which order it lists voxels that were turned."""
    if frame.turned and isinstance(found, np.ndarray) and as_labelled(given) is None:
        raise SceneError(
            f"{name} must be an xarray.DataArray, as the density is: its voxels were turned from "
            f"{frame.given} to (z, y, x), ascending; got an array without names"
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
