"""Arrays with named axes and coordinates: an `xarray.DataArray` as an array (z, y, x) in its frame.

xarray is not imported: whoever passes one of its objects has done so.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._errors import SceneError

AXES = {"z": "z", "height": "z", "altitude": "z", "lev": "z", "level": "z", "y": "y", "x": "x"}
NAMELESS = ("dim_0", "dim_1", "dim_2")  # xarray's names of axes that were given none
ANGLES = ("lat", "lon", "latitude", "longitude", "rlat", "rlon")
CHANNELS = ("channel", "rgb", "band", "c")
EVEN = 1e-3  # of a voxel: what a coordinate may be off its even place
METRES = ("m", "meter", "meters", "metre", "metres")
PRESSURES = ("pa", "hpa", "mb", "mbar", "millibar", "millibars", "bar")

Triple = tuple[float, float, float]


def as_labelled(value: Any) -> Any:
    """A DataArray of a DataArray or a Variable of xarray; None of anything else.

    Raises
    ------
    SceneError
        If it is a Dataset.
    """
    xarray = sys.modules.get("xarray")
    if xarray is None:
        return None
    if isinstance(value, xarray.Dataset):
        names = ", ".join(repr(str(name)) for name in value.data_vars)
        raise SceneError(
            f"an xarray.Dataset was given, with the variables {names}: pass one of them, "
            "dataset[name]"
        )
    if isinstance(value, xarray.Variable):
        return xarray.DataArray(value)
    return value if isinstance(value, xarray.DataArray) else None


@dataclass(frozen=True, eq=False)
class Frame:
    """Names and coordinates of the axes, in the order (z, y, x), ascending.

    Parameters
    ----------
    dims : tuple of str
        Their names.
    given : tuple of str
        All names of the array, in its own order.
    flipped : tuple of str
        Those that were descending.
    coordinates : tuple of float64 arrays, or None
        Centres of the voxels; None where the array has no coordinates.
    unit : str or None
        What `units` of the coordinates says.
    """

    dims: tuple[str, ...] = ("z", "y", "x")
    given: tuple[str, ...] = ("z", "y", "x")
    flipped: tuple[str, ...] = ()
    coordinates: tuple[np.ndarray, ...] | None = None
    unit: str | None = None

    @property
    def turned(self) -> bool:
        """Whether the voxels are in another order than in the array that was given."""
        return bool(self.flipped) or self.given[:3] != self.dims

    def placed(self, spacing: Triple | None, origin: Triple | None) -> tuple[Triple, Triple]:
        """Spacing (dz, dy, dx) and origin (x, y, z), which if given must be the coordinates'.

        Raises
        ------
        SceneError
            If they are not, or if a single voxel's coordinate leaves its size open.
        """
        if self.coordinates is None:
            return spacing or (1.0, 1.0, 1.0), origin or (0.0, 0.0, 0.0)
        for dim, centres in zip(self.dims, self.coordinates, strict=True):
            if len(centres) == 1 and spacing is None:
                raise SceneError(
                    f"{dim} has one voxel, whose size its coordinate does not tell; give "
                    "spacing=(dz, dy, dx)"
                )
        steps = spacing or (1.0, 1.0, 1.0)  # the size of single voxels
        read = tuple(
            float(centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else step
            for centres, step in zip(self.coordinates, steps, strict=True)
        )
        corner = tuple(
            float(centres[0]) - step / 2
            for centres, step in zip(self.coordinates, read, strict=True)
        )[::-1]
        if spacing is not None:
            # `EVEN` of a voxel at the far end
            counts = [max(len(centres) - 1, 1) for centres in self.coordinates]
            off = np.abs(np.subtract(spacing, read)) * counts
            if not (off <= EVEN * np.abs(read)).all():
                raise _conflict("spacing", spacing, read, "(dz, dy, dx)")
            read = spacing
        if origin is not None:
            if not (np.abs(np.subtract(origin, corner)) <= EVEN * np.abs(read[::-1])).all():
                raise _conflict("origin", origin, corner, "(x, y, z), coordinates are centres")
            corner = origin
        return read, corner  # type: ignore[return-value]

    def agrees(self, other: Frame, spacing: Triple, origin: Triple) -> bool:
        """Whether its coordinates, if any, are those of another frame, within `EVEN` of a voxel.

        Where the other has none, the centres of the voxels of this spacing and origin.
        """
        if self.coordinates is None:
            return True
        there = other.coordinates or tuple(
            low + (np.arange(len(centres)) + 0.5) * step
            for centres, step, low in zip(self.coordinates, spacing, origin[::-1], strict=True)
        )
        return all(
            len(one) == len(two) and np.allclose(one, two, rtol=0, atol=EVEN * step)
            for one, two, step in zip(self.coordinates, there, spacing, strict=True)
        )

    def row(self, spacing: Triple, origin: Triple) -> tuple[str, str, str]:
        """The decision that a plan prints."""
        choice = f"xarray: dims ({', '.join(self.given)}) taken as (z, y, x)"
        if self.flipped:
            choice += f", {' and '.join(self.flipped)} flipped to ascend"
        where = f"spacing {_show(spacing)}, origin {_show(origin)}"
        if self.coordinates is None:
            return "volume", choice, f"it has no coordinates: {where}"
        unit = f" in {self.unit}" if self.unit else ""
        return "volume", choice, f"{where}{unit} from its coordinates, the voxels' centres"


def _show(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


def _conflict(name: str, given: Triple, read: Sequence[float], order: str) -> SceneError:
    return SceneError(
        f"{name} = {_show(given)} is given, and the coordinates of the xarray.DataArray say "
        f"{_show(read)} {order}; drop one"
    )


def read(name: str, array: Any) -> tuple[Any, Frame]:
    """The data of a DataArray in the order (z, y, x[, channel]), ascending, and their frame.

    Raises
    ------
    SceneError
        If the names of its dims or its coordinates do not say where each voxel is.
    """
    given = tuple(map(str, array.dims))
    order = _order(name, array, given)
    dims = tuple(given[i] for i in order[:3])
    data = array.transpose(*(array.dims[i] for i in order)).data
    if array.size == 0:
        return data, Frame(dims, given)
    coordinates, unit = _coordinates(name, array, [array.dims[i] for i in order[:3]])
    flipped = []
    for axis, centres in enumerate(coordinates or ()):
        if centres[0] > centres[-1]:
            data = data[(slice(None),) * axis + (slice(None, None, -1),)]
            flipped.append(dims[axis])
    if coordinates is not None:
        coordinates = tuple(np.sort(centres) for centres in coordinates)
    return data, Frame(dims, given, tuple(flipped), coordinates, unit)


def _order(name: str, array: Any, given: tuple[str, ...]) -> tuple[int, ...]:
    """Places of z, y, x (and of the channel) among the dims."""
    if given == NAMELESS:
        return 0, 1, 2
    found: dict[str, int] = {}
    for i, dim in enumerate(given):
        axis = AXES.get(dim.lower(), "")
        if not axis and dim.lower() in CHANNELS and array.ndim == 4:
            axis = "channel"
        if not axis or axis in found:
            raise SceneError(
                f"{name} is an xarray.DataArray with the dims {given}; {_why(dim, found.get(axis))}"
            )
        found[axis] = i
    if not {"x", "y", "z"} <= found.keys():
        raise SceneError(
            f"{name} is an xarray.DataArray with the dims {given}; x, y and z (or height, "
            "altitude, lev, level) are needed: da.expand_dims(z=[...]) adds one"
        )
    return tuple(found[axis] for axis in ("z", "y", "x", "channel") if axis in found)


def _why(dim: str, twice: int | None) -> str:
    """Why a dim is refused, and what to do."""
    if twice is not None:
        return f"two of them mean the same axis, the second is {dim}"
    if dim.lower() in ANGLES:
        return f"{dim} is an angle: interpolate to x and y in a unit of length, da.interp(...)"
    if dim.lower() == "depth":
        new = f"z=('{dim}', -da.{dim}.values)"
        return f"{dim} counts downwards: da.assign_coords({new}).swap_dims({dim}='z')"
    if dim.lower() == "time":
        return f"pick one {dim}: da.isel({dim}=0)"
    return (
        f"{dim} is none of x, y, z, height, altitude, lev, level: rename it, "
        f"da.rename({dim}='z'), or pick one of it, da.isel({dim}=0)"
    )


def _coordinates(
    name: str, array: Any, dims: Sequence[Any]
) -> tuple[tuple[np.ndarray, ...] | None, str | None]:
    """The coordinates of three dims, evenly spaced, and their unit; None if there are none."""
    for dim in dims:
        for other, coordinate in array.coords.items():
            if other != dim and coordinate.dims == (dim,) and str(other).lower() in AXES:
                raise SceneError(
                    f"{name}: {other} lies along {dim} without being its coordinate; say which is "
                    f"meant: da.swap_dims({dim}='{other}').drop_vars('{dim}'), or "
                    f"da.drop_vars('{other}')"
                )
    without = [dim for dim in dims if dim not in array.coords]
    if len(without) == 3:
        return None, None
    if without:
        others = ", ".join(repr(str(dim)) for dim in dims if dim in array.coords)
        raise SceneError(
            f"{name}: {', '.join(map(str, without))} has no coordinate, unlike {others}; give all "
            f"three, or none: da.drop_vars([{others}])"
        )
    found = [array.coords[dim] for dim in dims]
    return tuple(_even(name, one) for one in found), _unit(name, found)


def _even(name: str, coordinate: Any) -> np.ndarray:
    """A coordinate as float64, evenly spaced within `EVEN` of a step or its own rounding."""
    dim, values = coordinate.name, np.asarray(coordinate.data)
    if values.dtype.kind not in "iuf":
        raise SceneError(
            f"{name}: the coordinate {dim} is of dtype {values.dtype}, lengths are needed"
        )
    centres = values.astype(np.float64)
    if not np.isfinite(centres).all():
        raise SceneError(f"{name}: the coordinate {dim} is not finite everywhere")
    n = len(centres)
    step = (centres[-1] - centres[0]) / max(n - 1, 1)
    if n > 1:
        rounding = np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0.0
        off = np.abs(centres - (centres[0] + step * np.arange(n)))
        allowed = EVEN * abs(step) + min(2.0 * rounding * np.abs(centres).max(), 0.1 * abs(step))
        if step == 0.0 or not (off <= allowed).all():
            steps = np.diff(centres)
            even = f"np.linspace({centres[0]:.6g}, {centres[-1]:.6g}, {n})"
            raise SceneError(
                f"{name}: {dim} is not evenly spaced, its steps are {steps.min():.6g} to "
                f"{steps.max():.6g}; resample it: da.interp({dim}={even})"
            )
    return centres


def _unit(name: str, coordinates: Sequence[Any]) -> str | None:
    """The one unit of length that all coordinates have, or none has."""
    units = {str(one.name): _spelled(one.attrs.get("units")) for one in coordinates}
    for one in coordinates:
        dim, unit = str(one.name), units[str(one.name)]
        if unit is not None and (unit.lower().startswith("deg") or unit.lower() in PRESSURES):
            raise SceneError(
                f"{name}: the coordinate {dim} is in {unit}, which is no length; interpolate to "
                "lengths: da.interp(...)"
            )
        if str(one.attrs.get("positive", "up")).lower() == "down":
            raise SceneError(
                f"{name}: the coordinate {dim} counts downwards (its attribute `positive`); z "
                f"counts upwards: da.assign_coords({dim}=-da.{dim}.values)"
            )
    if len(set(units.values())) > 1:
        given = ", ".join(f"{dim} in {unit or 'no unit'}" for dim, unit in units.items())
        raise SceneError(
            f"{name}: the coordinates differ in their units ({given}); convert them to one, "
            "or drop their attribute units"
        )
    return units[str(coordinates[0].name)]


def _spelled(unit: Any) -> str | None:
    """A unit in one spelling; None for none or a pure number."""
    text = "" if unit is None else str(unit).strip()
    if text.lower() in ("", "1", "none", "dimensionless"):
        return None
    lower = text.lower()
    if lower in METRES:
        return "m"
    return "km" if lower in ("km", *(f"kilo{word}" for word in METRES[1:])) else text
