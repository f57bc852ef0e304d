"""Results to and from files: npz, OpenEXR, xarray."""

import json
import os
import zipfile
from contextlib import suppress
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import SceneError
from .display import QUANTITIES, box_ends

if TYPE_CHECKING:
    from ._result import Result
    from ._scene import Camera

FORMAT = "mcrt result 1"


def save(result: "Result", path: str | PathLike[str]) -> None:
    """Write a result to a NumPy archive: the arrays as they are, everything else as JSON.

    What has the name is replaced once all is written.
    """
    arrays: dict[str, Any] = {}

    def strip(value: Any, name: str) -> Any:
        """The value with each array replaced by a reference to its entry of the archive."""
        if isinstance(value, np.ndarray):
            arrays[name] = value
            return {"array": name}
        if isinstance(value, dict):
            return {key: strip(item, f"{name}/{key}") for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [strip(item, f"{name}/{i}") for i, item in enumerate(value)]
        return value.item() if isinstance(value, np.generic) else value

    parts = {"scene": result._scene, "settings": result._settings, "data": result._whole()}
    text = {name: strip(part, name) for name, part in parts.items()}
    text |= {"format": FORMAT, "seeds": list(result._seeds)}
    unfinished = f"{os.fspath(path)}.part"
    try:
        with open(unfinished, "wb") as file:
            np.savez(file, json=np.array(json.dumps(text)), **arrays)
        os.replace(unfinished, path)
    except BaseException:
        with suppress(OSError):
            os.remove(unfinished)
        raise


def load(path: str | PathLike[str]) -> tuple[Any, Any, Any, tuple[int, ...]]:
    """Read what `save` wrote: scene, settings, data and seeds."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            text = json.loads(archive["json"].item())
            if text["format"] != FORMAT:
                raise SceneError(f"{path} has the format {text['format']!r}, not {FORMAT!r}")

            def fill(value: Any) -> Any:
                """The value with its arrays back in place, and tuples for lists."""
                if isinstance(value, dict):
                    name = value.get("array")
                    if isinstance(name, str):
                        return archive[name]
                    return {key: fill(item) for key, item in value.items()}
                return tuple(map(fill, value)) if isinstance(value, list) else value

            scene, settings, data = (fill(text[part]) for part in ("scene", "settings", "data"))
            seeds = tuple(text["seeds"])
    except SceneError:
        raise
    except (zipfile.BadZipFile, KeyError, TypeError, AttributeError, EOFError, ValueError) as error:
        raise SceneError(f"{path} is not a result that save() wrote") from error
    return scene, settings, data, seeds


def save_exr(result: "Result", path: str | PathLike[str], camera: "Camera | None" = None) -> None:
    """Write the layers of an image to one OpenEXR file, float32."""
    try:
        import OpenEXR
    except ImportError as error:
        raise ImportError("save_exr needs OpenEXR: pip install OpenEXR") from error
    total = result.image(camera)
    layers = {"": total, "total.": total}
    layers["order0."] = result.image(camera, 0)
    layers["order1."] = result.image(camera, 1)
    if result._scene.get("emission") is not None:
        layers["emission."] = result.image(camera, "emission")
    if result.plan.method != "single":
        layers["order2plus."] = result.image(camera, "2+")
    channels = {}
    for layer, image in layers.items():
        rgb = (
            np.broadcast_to(image[..., np.newaxis], (*image.shape, 3)) if image.ndim == 2 else image
        )
        for i, name in enumerate("RGB"):
            channels[layer + name] = np.ascontiguousarray(rgb[..., i], dtype=np.float32)
    alpha = result.alpha(camera)
    channels["A"] = np.ascontiguousarray(alpha.mean(axis=-1) if alpha.ndim == 3 else alpha)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def to_xarray(result: "Result") -> Any:
    """The voxel arrays and the image of a result as an `xarray.Dataset` with units.

    Of a density that was a DataArray, the axes have its names, coordinates and unit of length.
    """
    try:
        import xarray
    except ImportError as error:
        raise ImportError("to_xarray needs xarray: pip install xarray") from error
    outputs, errors = result._settings["outputs"], result._settings["errors"]
    channel = ("channel",) if result.plan.channels == 3 else ()
    suffixes = ("", "_error") if errors else ("",)
    frame = result._scene.get("frame") or {"dims": ("z", "y", "x"), "coordinates": None}
    dims, length = frame["dims"], frame.get("unit") or "length"
    variables: dict[str, Any] = {}
    for name, unit in QUANTITIES.items():
        if ("fluence" if name == "absorbed" else name) in outputs:
            for suffix in suffixes:
                values = getattr(result, name + suffix)
                attributes = {"units": unit.replace("length", length)}
                variables[name + suffix] = ((*dims, *channel), values, attributes)
    if "image" in outputs:
        units = {"units": QUANTITIES["radiance"].replace("length", length)}
        variables["image"] = (("row", "column", *channel), result.image(), units)
        variables["alpha"] = (("row", "column", *channel), result.alpha(), {"units": "1"})
    coordinates: dict[str, Any] = {"channel": list("RGB")} if channel else {}
    centres = frame["coordinates"] or [
        lower + (np.arange(n) + 0.5) * step
        for (lower, _), n, step in zip(
            box_ends(result),
            result._scene["density"].shape,
            result._scene["spacing"],
            strict=True,
        )
    ]
    for name, values in zip(dims, centres, strict=True):
        coordinates[name] = (name, values, {"units": length})
    return xarray.Dataset(variables, coordinates, {"mcrt": str(result)})
