"""Scenes for other programs: `to_mitsuba`, a dictionary for Mitsuba 3's `load_dict`."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _simulate
from ._errors import SceneError
from ._medium import Medium
from ._records import Plan
from ._result import Result

Dict = dict[str, Any]
EPSILON = 1500 * 2.0**-24  # of Mitsuba's rays
TABLE = 4097  # points of a resampled phase function


def to_mitsuba(scene: ArrayLike | Medium | Plan | Result, **arguments: Any) -> Dict:
    """The scene as a dictionary for Mitsuba 3: `mitsuba.load_dict(mcrt.interop.to_mitsuba(...))`.

        mitsuba.set_variant("llvm_ad_rgb")
        scene = mitsuba.load_dict(mcrt.interop.to_mitsuba(density, extinction=8.0, light=light))
        image = mitsuba.render(scene, spp=256)  # what result.image() is

    Everything is in world coordinates. The image is that of `Result.image()`: light that was
    scattered at least once, without the background. It is `volpath` (`volpathmis` where the
    channels differ in extinction) without Russian roulette, which in Mitsuba counts null
    collisions too; RGB where the scene is, else luminance. The medium is a grid, of one voxel where
    all are equal, in a box that is slightly larger than the voxels: see the notes.

    Parameters
    ----------
    scene : Result, Plan, Medium or array (nz, ny, nx)
        What ran, what would run, or what `simulate` takes as its volume.
    **arguments
        As for `simulate`, with its defaults, where `scene` is a volume. Those that say how to run
        (method, photons, ...) are checked and make no difference.

    Returns
    -------
    dict
        With the keys `integrator`, `sensor`, `medium`, `box`, and `light0`, `light1`, ...

    Raises
    ------
    SceneError
        If Mitsuba cannot represent the scene: `PencilBeam`, emission, more than one
        `EnvironmentLight`, albedo per voxel with linear interpolation (Mitsuba interpolates albedo
        and extinction each by itself; exact with "nearest"), an orthographic image plane that cuts
        the box, RGB in a variant of one channel. If no variant, or a spectral one, is set.
    ImportError
        If Mitsuba is not installed.

    Notes
    -----
    Mitsuba computes in single precision and world coordinates: move a scene whose origin is much
    farther from 0 than its extent. Where a ray crosses the surface of a shape it starts anew
    8.9e-5 (1 + its largest coordinate) deep inside, and what would scatter on the way is lost:
    order 1 of a homogeneous box of optical depth 30 is 0.5 % too dark in the best of units, and
    13 % where its sides are 0.1 long. Grids end where they should, whatever surrounds them: hence
    the larger box (right within 0.1 %, and 0.6 % where the sides are 0.1 long). A `Medium.sphere`
    has no such help. A `PointLight` inside the medium is too bright by 8.9e-4 of its optical depth,
    and its variance is infinite. A
    `TabulatedPhase` whose cosines are not equidistant is resampled at 4097 points, between which it
    stays linear.
    """
    spec, orders = _described(scene, arguments)
    mi = _mitsuba()
    values = [spec["extinction"], *(light[-1] for light in spec["lights"])]
    if not isinstance(spec["albedo"], np.ndarray):
        values.append(spec["albedo"])
    rgb = any(_channels(value) == 3 for value in values)
    if rgb and "mono" in mi.variant():
        raise SceneError(f"the scene is RGB and Mitsuba's variant {mi.variant()} is not")
    if spec.get("emission") is not None:
        raise SceneError("Mitsuba's media do not emit; leave out emission")
    if sum(light[0] == "environment" for light in spec["lights"]) > 1:
        raise SceneError("Mitsuba takes one environment; add the EnvironmentLights up in a map")
    chromatic = len(set(spec["extinction"])) > 1
    return {
        "type": "scene",
        "integrator": {
            "type": "volpathmis" if chromatic else "volpath",
            "max_depth": -1 if orders is None else orders + 1,
            "rr_depth": 1_000_000,
            "hide_emitters": True,
        },
        "medium": _ball(spec) if spec["shape"] == "sphere" else _medium(mi, spec),
        "sensor": _sensor(mi, spec, "rgb" if rgb else "luminance"),
        "box": {
            **_shape(mi, spec),
            "bsdf": {"type": "null"},
            "interior": {"type": "ref", "id": "medium"},
        },
        **{f"light{i}": _light(mi, light) for i, light in enumerate(spec["lights"])},
    }


def _mitsuba() -> Any:
    """The module, with a variant that the translation is meant for."""
    try:
        import mitsuba
    except ImportError as error:
        raise ImportError("to_mitsuba needs Mitsuba 3: pip install mitsuba") from error
    variant = mitsuba.variant()
    if variant is None:
        raise SceneError('no variant of Mitsuba is set; call mitsuba.set_variant("llvm_ad_rgb")')
    if "spectral" in variant or "polarized" in variant:
        raise SceneError(f"Mitsuba's variant must be of rgb or mono; it is {variant}")
    return mitsuba


def _described(scene: Any, arguments: Dict) -> tuple[Dict, int | None]:
    """The scene as the Rust core takes it, and `max_scatterings`."""
    if not isinstance(scene, Result | Plan):
        call = inspect.signature(_simulate.simulate).bind(scene, **arguments)
        call.apply_defaults()
        spec, settings, _ = _simulate._parse(dict(call.arguments))
    elif arguments:
        raise SceneError(f"{', '.join(arguments)} given beside a {type(scene).__name__}; drop them")
    elif scene._scene is None:
        raise SceneError("the plan of a result describes no scene; give the result")
    elif isinstance(scene, Result):
        spec, settings = scene._scene, scene._settings
    else:
        spec, settings = scene._scene
    return spec, settings["max_scatterings"]


def _channels(value: Any) -> int:
    """Channels of a value (a tuple), or of an array, whose last axis may hold them."""
    if isinstance(value, np.ndarray):
        return value.shape[2] if value.ndim == 3 else 1
    return len(value)


def _value(value: tuple[float, ...]) -> Dict:
    """One number per channel as Mitsuba's spectrum; grey is the same in all."""
    return {"type": "rgb", "value": value[0] if len(value) == 1 else list(value)}


def _size(spec: Dict) -> np.ndarray:
    """Extents (x, y, z) of the box."""
    return np.multiply(spec["density"].shape, spec["spacing"])[::-1]


def _holder(spec: Dict) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half extents of the box that holds the medium, larger by 4 ray epsilons."""
    low, size = np.array(spec["origin"]), _size(spec)
    farthest = np.maximum(np.abs(low), np.abs(low + size)).max()
    return low + size / 2, size / 2 + 4 * EPSILON * (1 + farthest)


def _shape(mi: Any, spec: Dict) -> Dict:
    """The sphere, or the box that holds the medium."""
    middle, half = _holder(spec)
    if spec["shape"] == "sphere":
        radius = float(_size(spec)[0]) / 2
        return {"type": "sphere", "center": middle.tolist(), "radius": radius}
    scaled = mi.ScalarTransform4f().translate(middle.tolist()).scale(half.tolist())
    return {"type": "cube", "to_world": scaled}  # the cube is [-1, 1]^3


def _box(mi: Any, spec: Dict) -> Any:
    """The transform of [0, 1]^3 to the box."""
    return mi.ScalarTransform4f().translate(list(spec["origin"])).scale(_size(spec).tolist())


# Medium


def _ball(spec: Dict) -> Dict:
    """The homogeneous medium of a sphere."""
    medium = {"type": "homogeneous", "sigma_t": _value(spec["extinction"])}
    return medium | {"albedo": _value(spec["albedo"]), "phase": _phase(spec["phase"])}


def _medium(mi: Any, spec: Dict) -> Dict:
    """sigma_t = scale * (density * ratio of the channels), albedo, and the phase function."""
    density, albedo = spec["density"], spec["albedo"]
    scale = max(spec["extinction"])
    ratio = np.array(spec["extinction"], np.float32) / (scale or 1.0)
    medium = {"type": "heterogeneous", "scale": scale, "phase": _phase(spec["phase"])}
    if isinstance(albedo, np.ndarray):
        if spec["linear"]:
            raise SceneError(
                "Mitsuba interpolates albedo and extinction each by itself, mcrt their product: an "
                'albedo per voxel is the same in both with interpolation="nearest" only'
            )
        medium["albedo"] = _grid(mi, spec, albedo[..., np.newaxis])
    else:
        medium["albedo"] = _value(albedo)
    if (density == density.flat[0]).all():
        density = density[:1, :1, :1]
    grid = density[..., np.newaxis] * (ratio if len(set(spec["extinction"])) > 1 else ratio[:1])
    return medium | {"sigma_t": _grid(mi, spec, grid)}


def _grid(mi: Any, spec: Dict, values: np.ndarray) -> Dict:
    """Voxels (nz, ny, nx, c) that fill the box."""
    return {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(np.ascontiguousarray(values, np.float32)),
        "filter_type": "trilinear" if spec["linear"] else "nearest",
        "wrap_mode": "clamp",
        "raw": True,
        "accel": False,  # a texture unit would interpolate with 8 bits
        "to_world": _box(mi, spec),
    }


def _phase(spec: tuple[Any, ...]) -> Dict:
    """Rayleigh and isotropic by name; g > 0 scatters forward in both programs."""
    kind, *fields = spec
    if kind == "hg":
        return {"type": "hg", "g": fields[0]}
    if kind == "tabulated":
        cosines, values = np.array(fields)
        even = np.linspace(-1.0, 1.0, len(cosines))
        if not np.allclose(cosines, even, rtol=0, atol=1e-9):
            even = np.linspace(-1.0, 1.0, TABLE)
        table = np.interp(even, cosines, values)
        return {"type": "tabphase", "values": ", ".join(map(repr, table.tolist()))}
    return {"type": kind}


# Lights


def _light(mi: Any, spec: tuple[Any, ...]) -> Dict:
    kind, *fields = spec
    if kind == "point":
        return {"type": "point", "position": list(fields[0]), "intensity": _value(fields[1])}
    if kind == "directional":
        direction, irradiance = fields
        return {
            "type": "directional",
            "direction": list(direction),
            "irradiance": _value(irradiance),
        }
    if kind == "environment":
        (radiance,) = fields
        if isinstance(radiance, np.ndarray):
            return _envmap(mi, radiance)
        return {"type": "constant", "radiance": _value(radiance)}
    raise SceneError(f"Mitsuba has no {kind} light: no PencilBeam is infinitely thin there")


def _envmap(mi: Any, radiance: np.ndarray) -> Dict:
    """A map (h, w[, 3]) whose first row is next to +z and whose column c is at the azimuth
    atan2(d_x, d_y) = 2 pi ((c + 1/2) / w - 1/2).

    Mitsuba's columns are as ours, but its first and last row are the poles themselves: row j of
    2 h + 1 is at the polar angle pi j / (2 h), which has our rows at odd j, and between them what
    ours interpolates linearly.
    """
    rows = np.asarray(radiance, np.float32)
    rows = np.concatenate([rows[:1], rows, rows[-1:]])
    twice = np.empty((2 * len(radiance) + 1, *radiance.shape[1:]), np.float32)
    twice[1::2] = rows[1:-1]
    twice[0::2] = (rows[:-1] + rows[1:]) / 2
    if twice.ndim == 2:
        twice = np.repeat(twice[..., np.newaxis], 3, axis=-1)
    # Its y axis is up, and its azimuth is atan2(x, -z): (-x, z, y) of ours.
    local_from_world = np.array([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(twice),
        "to_world": mi.ScalarTransform4f(local_from_world.T.astype(float)),
    }


# Cameras


def _sensor(mi: Any, spec: Dict, pixel_format: str) -> Dict:
    """The camera; inside the box it starts in the medium."""
    kind, origin, target, up, extent, (width, height) = spec["camera"]
    transform = mi.ScalarTransform4f().look_at(
        origin=list(origin), target=list(target), up=_up(origin, target, up)
    )
    middle, half = _holder(spec)
    corners = middle + half * (2 * np.indices((2, 2, 2)).reshape(3, 8).T - 1)
    inside = bool(np.all(np.abs(origin - middle) < half))
    far = 2.0 * np.linalg.norm(corners - origin, axis=1).max()
    sensor = {
        "near_clip": float(1e-6 * far),  # light from nearer is not seen
        "far_clip": float(far),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": pixel_format,
            "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }
    if kind == "perspective":
        if inside:
            sensor["medium"] = {"type": "ref", "id": "medium"}
        camera = {"type": kind, "fov": extent, "fov_axis": "x", "to_world": transform}
        return camera | sensor
    ahead = (corners - origin) @ np.subtract(target, origin) > 0
    if ahead.any() and not ahead.all():
        raise SceneError(
            "the plane of the OrthographicCamera cuts the box, and Mitsuba's rays start either all "
            "in the medium or all outside; move its origin back"
        )
    # Its film is 2 wide.
    scaled = transform @ mi.ScalarTransform4f().scale([extent / 2, extent / 2, 1.0])
    return {"type": kind, "to_world": scaled} | sensor


def _up(origin: Any, target: Any, up: Any) -> list[float]:
    """What is up; where the view is along it, the axis that the view is least along."""
    forward = np.subtract(target, origin)
    forward /= np.linalg.norm(forward)
    if np.abs(np.cross(forward, np.array(up) / np.linalg.norm(up))).max() < 1e-9:
        return np.eye(3)[np.argmin(np.abs(forward))].tolist()
    return list(up)
