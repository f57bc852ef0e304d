"""Phase functions, lights and cameras: frozen records, validated where they are made.

Points and directions are world (x, y, z). A value per channel is a number, or three for RGB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _mcrt
from ._arguments import Value, channels, integer, number, numeric, rgb, single, vector, wrong

Spec = tuple[Any, ...]


def _set(record: object, **fields: object) -> None:
    for name, value in fields.items():
        object.__setattr__(record, name, value)


class Phase:
    """A phase function p(cos_theta) [1/sr], whose integral over the sphere of directions is 1."""

    def _spec(self) -> Spec:
        raise NotImplementedError

    def evaluate(self, cos_theta: ArrayLike) -> np.ndarray:
        """Value of the phase function [1/sr], float64, of the shape of `cos_theta` in [-1, 1]."""
        cosines = numeric("cos_theta", cos_theta, "numbers").astype(np.float64)
        return _mcrt.phase_eval(self._spec(), cosines.ravel()).reshape(cosines.shape)

    def sample(self, n: int, seed: int = 0) -> np.ndarray:
        """`n` cosines of scattering angles drawn from the phase function, float64, shape (n,)."""
        n = integer("n", n, 0, 10**9)
        return _mcrt.phase_sample(self._spec(), n, integer("seed", seed, 0, 2**64 - 1))


@dataclass(frozen=True)
class Isotropic(Phase):
    """Equal scattering into all directions: p = 1 / (4 pi) [1/sr]."""

    def _spec(self) -> Spec:
        return ("isotropic",)


@dataclass(frozen=True)
class Rayleigh(Phase):
    """Particles much smaller than the wavelength: p = 3 (1 + cos_theta^2) / (16 pi) [1/sr]."""

    def _spec(self) -> Spec:
        return ("rayleigh",)


@dataclass(frozen=True)
class HenyeyGreenstein(Phase):
    """The phase function of Henyey and Greenstein (1941), whose mean cosine is g.

    p = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos_theta)^(3/2)) [1/sr]

    Parameters
    ----------
    g : float
        Mean cosine, -1 < g < 1; g > 0 scatters forward.

    Raises
    ------
    SceneError
        If |g| >= 1.
    """

    g: float

    def __post_init__(self) -> None:
        _set(self, g=number("g", self.g))
        _mcrt.check_phase(self._spec())

    def _spec(self) -> Spec:
        return ("hg", self.g)


@dataclass(frozen=True)
class TabulatedPhase(Phase):
    """A phase function given as a table, linear between its points and normalised to 1.

    Parameters
    ----------
    cos_theta : sequence of float, shape (n,)
        Increasing cosines from -1 to 1, n >= 2.
    values : sequence of float, shape (n,)
        Values at these cosines, not negative, in any unit.

    Raises
    ------
    SceneError
        If the table is too short, not increasing, negative, or zero everywhere.
    """

    cos_theta: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        for name in ("cos_theta", "values"):
            given = getattr(self, name)
            array = numeric(name, given, "a 1-D sequence of numbers")
            if array.ndim != 1:
                raise wrong(name, "a 1-D sequence of numbers", given)
            _set(self, **{name: tuple(float(v) for v in array)})
        _mcrt.check_phase(self._spec())

    def _spec(self) -> Spec:
        return ("tabulated", self.cos_theta, self.values)


class Light:
    """A source of light."""

    def _spec(self) -> Spec:
        raise NotImplementedError


@dataclass(frozen=True)
class PointLight(Light):
    """A point that shines equally into all directions, outside the medium or inside.

    Parameters
    ----------
    position : (x, y, z)
    intensity : float or RGB
        Radiant intensity [W/sr]; the light emits 4 pi times as much [W].
    """

    position: tuple[float, float, float]
    intensity: Value = 1.0

    def __post_init__(self) -> None:
        _set(self, position=vector("position", self.position))
        _set(self, intensity=rgb("intensity", self.intensity))
        _mcrt.check_light(self._spec())

    def _spec(self) -> Spec:
        return ("point", self.position, channels(self.intensity))


@dataclass(frozen=True)
class PencilBeam(Light):
    """An infinitely thin beam.

    Parameters
    ----------
    position : (x, y, z)
        Where the beam starts.
    direction : (x, y, z)
        Where it goes; need not be normalised.
    power : float or RGB
        Radiant power [W].
    """

    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    power: Value = 1.0

    def __post_init__(self) -> None:
        _set(self, position=vector("position", self.position))
        _set(self, direction=vector("direction", self.direction))
        _set(self, power=rgb("power", self.power))
        _mcrt.check_light(self._spec())

    def _spec(self) -> Spec:
        return ("pencil", self.position, self.direction, channels(self.power))


@dataclass(frozen=True)
class DirectionalLight(Light):
    """Parallel light from far away, like the sun's.

    Parameters
    ----------
    direction : (x, y, z)
        Where the light travels (not where it comes from); need not be normalised.
    irradiance : float or RGB
        Power per area on a plane perpendicular to the direction [W/length^2].
    """

    direction: tuple[float, float, float]
    irradiance: Value = 1.0

    def __post_init__(self) -> None:
        _set(self, direction=vector("direction", self.direction))
        _set(self, irradiance=rgb("irradiance", self.irradiance))
        _mcrt.check_light(self._spec())

    def _spec(self) -> Spec:
        return ("directional", self.direction, channels(self.irradiance))


@dataclass(frozen=True, eq=False)
class EnvironmentLight(Light):
    """Radiance from every direction: the same from each, like an overcast sky's, or that of a map.

    Parameters
    ----------
    radiance : float, RGB, or array (height, width) or (height, width, 3)
        Radiance [W/(sr length^2)] that comes from the sky. A 2-D or 3-D array is an equirectangular
        map, of any real numbers that are finite and not negative; one float32 copy is made. Three
        numbers are RGB.

    Raises
    ------
    SceneError
        If the array has another shape or no texels, or a value is NaN, infinite or negative (its
        index [row, column] or [row, column, channel] is given).

    Notes
    -----
    Rows go from up (+z) to down (-z): the polar angle of row r is theta = pi (r + 1/2) / height.
    The middle of the map looks along +y, and columns go to the right of a viewer who stands with z
    up: for the unit vector d to the sky, (column + 1/2) / width = 1/2 + atan2(d_x, d_y) / (2 pi),
    so that +x is a quarter of the width to the right of the middle, -x a quarter to its left, and
    -y at both ends. Light travels along -d. Bilinear between texel centres, wrapped in azimuth,
    clamped at the poles. Photons start at directions drawn by radiance times the area that the
    volume's box shows to them.
    """

    radiance: Value | np.ndarray = 1.0

    def __post_init__(self) -> None:
        expected = (
            "a number, 3 numbers (RGB), or a map: an array (height, width) or (height, width, 3)"
        )
        array = numeric("radiance", self.radiance, expected)
        if array.ndim >= 2:
            if array.ndim > 3 or array.shape[2:] not in ((), (3,)):
                raise wrong("radiance", expected, array)
            if array.size == 0:
                raise wrong("radiance", f"{expected} with at least one texel", array)
            index = "(row, column)" if array.ndim == 2 else "(row, column, channel)"
            _set(self, radiance=single("radiance", array, index))
        elif array.shape in ((), (3,)):
            _set(self, radiance=rgb("radiance", array))
        else:
            raise wrong("radiance", expected, self.radiance)
        _mcrt.check_light(self._spec())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, EnvironmentLight):
            return NotImplemented
        return np.array_equal(self.radiance, other.radiance)

    def __hash__(self) -> int:
        array = np.asarray(self.radiance)
        return hash((EnvironmentLight, array.shape, array.tobytes()))

    def _spec(self) -> Spec:
        radiance = self.radiance
        return ("environment", radiance if isinstance(radiance, np.ndarray) else channels(radiance))


class Camera:
    """What maps directions to pixels; images are (height, width[, 3]) and row 0 is the top."""

    def _spec(self) -> Spec:
        raise NotImplementedError


def _resolution(value: Any) -> tuple[int, int]:
    """A pair (width, height) of pixel counts."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or len(value) != 2:
        raise wrong("resolution", "a pair (width, height) of integers", value)
    return integer("width", value[0], 1, 65536), integer("height", value[1], 1, 65536)


@dataclass(frozen=True)
class PerspectiveCamera(Camera):
    """A pinhole camera.

    Parameters
    ----------
    origin, target : (x, y, z)
        The eye, and the point that is seen in the middle of the image.
    up : (x, y, z)
        Direction that points up in the image. A view along it takes the axis that it is least along
        (x before y before z), which the plan names.
    fov : float
        Field of view along x, in degrees, 0 < fov < 180.
    resolution : (width, height)
    """

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float = 40.0
    resolution: tuple[int, int] = (600, 600)

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            _set(self, **{name: vector(name, getattr(self, name))})
        _set(self, fov=number("fov", self.fov), resolution=_resolution(self.resolution))
        _mcrt.check_camera(self._spec())

    def _spec(self) -> Spec:
        return ("perspective", self.origin, self.target, self.up, self.fov, self.resolution)


@dataclass(frozen=True)
class OrthographicCamera(Camera):
    """A camera with parallel rays.

    Parameters
    ----------
    origin, target : (x, y, z)
        The middle of the image plane, and the point that is seen in the middle of the image.
    up : (x, y, z)
        Direction that points up in the image. A view along it takes the axis that it is least along
        (x before y before z), which the plan names.
    width : float
        Width of the image plane [length]; the height follows from the resolution.
    resolution : (width, height)
    """

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    width: float = 1.0
    resolution: tuple[int, int] = (600, 600)

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            _set(self, **{name: vector(name, getattr(self, name))})
        _set(self, width=number("width", self.width), resolution=_resolution(self.resolution))
        _mcrt.check_camera(self._spec())

    def _spec(self) -> Spec:
        return ("orthographic", self.origin, self.target, self.up, self.width, self.resolution)


def as_phase(phase: Any) -> Phase:
    """A phase function; None is isotropic."""
    if phase is None:
        return Isotropic()
    if not isinstance(phase, Phase):
        raise wrong("phase", "Isotropic, Rayleigh, HenyeyGreenstein or TabulatedPhase", phase)
    return phase


def as_lights(light: Any) -> list[Light]:
    """A light or a sequence of lights as a list, which may be empty."""
    expected = "PointLight, PencilBeam, DirectionalLight, EnvironmentLight, or a sequence of them"
    if isinstance(light, Light):
        return [light]
    if not isinstance(light, Sequence) or isinstance(light, str):
        raise wrong("light", expected, light)
    for i, one in enumerate(light):
        if not isinstance(one, Light):
            raise wrong(f"light[{i}]", expected, one)
    return list(light)


def as_camera(camera: Any) -> Camera:
    """A camera, or the error that says what one is."""
    if not isinstance(camera, Camera):
        raise wrong("camera", "PerspectiveCamera or OrthographicCamera", camera)
    return camera


def camera_from_spec(spec: Spec) -> Camera:
    """The camera that a spec of the Rust core describes."""
    kind, *fields = spec
    return {"perspective": PerspectiveCamera, "orthographic": OrthographicCamera}[kind](*fields)
