"""What a user may pass becomes floats, tuples and private float32 arrays, or a SceneError.

Types and shapes are checked here; the values (ranges, NaN) are checked by the Rust constructors.
What NumPy would drop on the way to an array (units, masked values, labels) is an error here.
"""

import inspect
import numbers
import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ._errors import McrtError, SceneError, VolumeTooLargeError
from ._labels import as_labelled

Value = float | tuple[float, float, float]
PLAIN = (int, float, bool, complex, str, bytes, type(None))  # carry nothing but their value


def describe(value: object) -> str:
    """Say in few words what was given."""
    if isinstance(value, np.ma.MaskedArray) and value.ndim > 0:
        return f"a masked array of shape {value.shape}"
    if isinstance(value, np.ndarray) and value.ndim > 0:
        kind = "an array" if type(value) is np.ndarray else f"a {type(value).__name__}"
        return f"{kind} of shape {value.shape} and dtype {value.dtype}"
    return f"{reprlib.repr(value)} ({type(value).__name__})"


def wrong(name: str, expected: str, value: object) -> SceneError:
    """The error for an argument that is not what is allowed."""
    unit = unit_of(value)
    if unit is None:
        return SceneError(f"{name} must be {expected}; got {describe(value)}")
    number = "magnitude" if hasattr(value, "magnitude") else "value"
    return SceneError(
        f"{name} must be {expected}, without a unit; got {describe(value)}: pass its number in the "
        f'unit that is meant here (lengths all in one), as .to("{unit}").{number} gives it'
    )


def unit_of(value: object) -> Any:
    """The unit that a quantity of astropy, pint, unyt or the like carries; None for others."""
    for owner in (value, getattr(value, "dtype", None)):
        for name in ("unit", "units"):
            unit = getattr(owner, name, None)
            if unit is not None and not isinstance(unit, str) and not inspect.isroutine(unit):
                return unit
    return None


def is_masked(array: np.ndarray) -> bool:
    """Whether a masked array, NumPy's or another subclass of its arrays, has a masked value."""
    mask = getattr(array, "mask", None) if type(array) is not np.ndarray else None
    return mask is not None and array.dtype.names is None and bool(np.any(mask))


def bare(name: str, value: Any, expected: str) -> Any:
    """A number, an array, or nested lists of them, that NumPy loses nothing of.

    Raises
    ------
    SceneError
        If a unit, a masked value, or names of axes would be lost.
    """
    if type(value) in PLAIN or isinstance(value, np.generic):
        return value
    labelled = as_labelled(value)
    if labelled is not None:
        if labelled.ndim > 0:
            raise SceneError(
                f"{name} must be {expected}; got an xarray.DataArray with the dims "
                f"{labelled.dims}, whose names and coordinates have no meaning here: pass its "
                "values (.values)"
            )
        value = labelled.data
    if unit_of(value) is not None:
        raise wrong(name, expected, value)
    array_like = hasattr(value, "__array__") or hasattr(value, "__dlpack__")
    if isinstance(value, Sequence) and not isinstance(value, memoryview) and not array_like:
        if all(type(item) in PLAIN for item in value):
            return value
        items = [bare(name, item, expected) for item in value]
        shapes = list(dict.fromkeys(np.shape(i) for i in items if isinstance(i, np.ndarray)))
        if len(shapes) > 1:
            given = f"{len(items)} arrays of the shapes {', '.join(map(str, shapes))}"
            raise SceneError(f"{name} must be {expected}; got {given}, which do not stack")
        return items
    if hasattr(value, "__dask_graph__"):
        return bare(name, value.compute(), expected)
    array = np.asanyarray(value)
    if array.dtype.kind == "O":
        if array.ndim == 0 and hasattr(value, "__dlpack__"):
            array = np.from_dlpack(value)
        for item in array.flat:
            if unit_of(item) is not None:
                raise wrong(name, expected, item)
    if unit_of(array) is not None:
        raise wrong(name, expected, array)
    if is_masked(array):
        raise wrong(name, f"{expected}, without a masked value (fill it: a.filled(0))", array)
    return np.asarray(array)


def not_yet(what: str) -> SceneError:
    """The error for a part of the interface that is not built."""
    return SceneError(f"{what} is not yet available")


def numeric(name: str, value: Any, expected: str, kinds: str = "iuf") -> np.ndarray:
    """`value` as an array whose dtype kind is one of `kinds`; copies only where it must."""
    try:
        array = np.asarray(bare(name, value, expected))
    except McrtError:
        raise
    except MemoryError as error:
        raise VolumeTooLargeError(f"{name}: {error}") from error
    except Exception as error:
        raise SceneError(f"{name} must be {expected}; got {describe(value)}: {error}") from error
    if array.dtype.kind not in kinds:
        given = value if array.ndim == 0 or not isinstance(value, Sequence) else array
        raise wrong(name, expected, given)
    return array


def number(name: str, value: Any) -> float:
    """A single real number."""
    expected = "a number"
    array = numeric(name, value, expected)
    if array.ndim != 0:
        raise wrong(name, expected, value)
    return float(array)


def positive(name: str, value: Any) -> float:
    """A single number in (0, inf)."""
    result = number(name, value)
    if not 0.0 < result < np.inf:
        raise wrong(name, "a positive finite number", value)
    return result


def integer(name: str, value: Any, low: int, high: int) -> int:
    """An integral number in [low, high]; `1e7` and `np.int64(5)` are integral too."""
    expected = f"an integral number from {low:,} to {high:,}"
    if unit_of(value) is not None:
        raise wrong(name, expected, value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise wrong(name, expected, value)
    given: Any = value
    try:
        whole = int(given)
    except (ValueError, OverflowError):  # NaN, infinity
        raise wrong(name, expected, value) from None
    if whole != given or not low <= whole <= high:
        raise wrong(name, expected, value)
    return whole


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise wrong(name, "True or False", value)
    return bool(value)


def choice(name: str, value: Any, allowed: Sequence[str], later: Sequence[str] = ()) -> str:
    """One of the `allowed` strings; those in `later` are names that are not built yet."""
    if isinstance(value, str) and value in later:
        raise not_yet(f'{name}="{value}"')
    if not isinstance(value, str) or value not in allowed:
        raise wrong(name, "one of " + ", ".join(f'"{a}"' for a in allowed), value)
    return value


def vector(name: str, value: Any) -> tuple[float, float, float]:
    """Three numbers."""
    expected = "3 numbers"
    array = numeric(name, value, expected)
    if array.shape != (3,):
        raise wrong(name, expected, value)
    x, y, z = array.tolist()
    return float(x), float(y), float(z)


def rgb(name: str, value: Any) -> Value:
    """A number, or three of them (RGB)."""
    expected = "a number or 3 numbers (RGB)"
    array = numeric(name, value, expected)
    if array.shape == ():
        return float(array)
    if array.shape == (3,):
        return vector(name, array)
    raise wrong(name, expected, value)


def channels(value: Value) -> tuple[float, ...]:
    """A value as the tuple of 1 or 3 floats that the Rust core takes."""
    return value if isinstance(value, tuple) else (value,)


def volume(name: str, value: Any) -> np.ndarray:
    """A private, read-only, C-ordered float32 copy of a 3-D array: the one copy at the border."""
    expected = "a 3-D array (nz, ny, nx) of real numbers"
    array = numeric(name, value, expected, kinds="biuf")
    if array.ndim != 3:
        raise wrong(name, expected, array if array.ndim else value)
    if array.size == 0:
        raise wrong(name, f"{expected} with at least one voxel", array)
    return single(name, array, "(k, j, i)")


def single(name: str, array: np.ndarray, index: str) -> np.ndarray:
    """A private, read-only, C-ordered float32 copy; `index` says what an index of it is called."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            copy = np.array(array, dtype=np.float32, order="C")
    except MemoryError as error:
        raise VolumeTooLargeError(
            f"{name} of shape {array.shape} needs {4 * array.size:.3g} bytes as float32: {error}"
        ) from error
    if array.dtype.kind == "f" and array.dtype.itemsize > 4:
        overflow = np.isinf(copy) & np.isfinite(array)
        if overflow.any():
            where = first_index(overflow)
            raise SceneError(
                f"{name} must fit float32 (at most 3.4e38); {np.count_nonzero(overflow)} values of "
                f"{describe(array)} do not, the first is {array[where]} at {index} = {where}"
            )
    copy.flags.writeable = False
    return copy


def first_index(mask: np.ndarray) -> tuple[int, ...]:
    """Index of the first True of an array."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))
