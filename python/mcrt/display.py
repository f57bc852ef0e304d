"""What a person sees: tone mapping, PNG, the summary in text and HTML, matplotlib plots."""

import base64
import struct
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from ._arguments import choice, integer
from ._errors import McrtError
from ._records import table

if TYPE_CHECKING:
    from ._result import Result
    from ._scene import Camera

QUANTITIES = {"fluence": "W/length²", "radiance": "W/(sr length²)", "absorbed": "W/length³"}
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


def tone_map(image: np.ndarray, exposure: float | None = None) -> np.ndarray:
    """Radiance as 8-bit sRGB: exposure, a soft shoulder for the highlights, the sRGB curve.

    The luminance Y = exposure * L becomes Y (1 + Y / 2.25) / (1 + Y) (Reinhard et al. 2002,
    equation 4, white at Y = 1.5); colours keep their ratios.

    Parameters
    ----------
    image : array (height, width) or (height, width, 3)
        Radiance, not negative.
    exposure : float, optional
        None brings the 98 % quantile of what is lit to Y = 1.

    Returns
    -------
    array of uint8, same shape
    """
    luminance = image @ LUMINANCE if image.ndim == 3 else image
    if exposure is None:
        lit = luminance[luminance > 1e-3 * luminance.max(initial=0.0)]
        exposure = 1.0 / float(np.quantile(lit, 0.98)) if lit.size else 1.0
    y = np.maximum(exposure * luminance, 0.0)
    scale = exposure * (1.0 + y / 2.25) / (1.0 + y)
    linear = np.clip(image * (scale[..., np.newaxis] if image.ndim == 3 else scale), 0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * srgb).astype(np.uint8)


def encode_png(pixels: np.ndarray) -> bytes:
    """An 8-bit array (height, width) or (height, width, 3) as a PNG file."""
    height, width = pixels.shape[:2]
    lines = pixels.reshape(height, -1)
    rows = np.full((height, 1 + lines.shape[1]), 2, dtype=np.uint8)  # filter 2: less the row above
    rows[0, 1:] = lines[0]
    np.subtract(lines[1:], lines[:-1], out=rows[1:, 1:])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    body = zlib.compress(rows.tobytes(), 6)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
    )


def picture(result: "Result", camera: "Camera | None" = None) -> bytes:
    """The tone-mapped image of a result as a PNG file."""
    return encode_png(tone_map(result.image(camera)))


def summary(result: "Result") -> list[tuple[str, str]]:
    """What ran, how long, how sure: rows of name and text."""
    plan, stats = result.plan, result.stats
    stages = ", ".join(f"{stage} {seconds:.2g} s" for stage, seconds in stats.seconds.items())
    rows = [
        ("ran", f"{plan.method} on {plan.backend}, tracker {plan.tracker}, {_orders(result)}"),
        ("took", f"{sum(stats.seconds.values()):.2g} s ({stages})"),
    ]
    if stats.photons:
        shot = f"{stats.photons:.3g}, {stats.photons_per_second:.2g} per second"
        what = "paths" if plan.method == "path" else "photons"
        rows.append((what, f"{shot}, stopped by {stats.stopped_by}"))
    if stats.photons and stats.relative_error is not None:
        rows.append(
            (
                "error",
                f"{_percent(stats.relative_error)} RMS, "
                f"median {_percent(stats.median_relative_error)}, "
                f"95 % are below {_percent(stats.relative_error_95)}",
            )
        )
    if plan.method == "path":
        return rows + [("warning", text) for text in result.warnings]
    energy = result.energy
    shares = {
        **{name: energy[name] for name in ("missed", "unscattered", "absorbed", "truncated")},
        "escaped": sum(energy.escaped.values()),
    }
    rows.append(("light", ", ".join(f"{name} {_percent(share)}" for name, share in shares.items())))
    return rows + [("warning", text) for text in result.warnings]


def _orders(result: "Result") -> str:
    last = 1 if result.plan.method == "single" else result._settings["max_scatterings"]
    if last is None:
        return "all orders of scattering"
    return f"at most {last} scattering{'' if last == 1 else 's'}"


def _percent(share: Any) -> str:
    return " / ".join(f"{100.0 * channel:.3g} %" for channel in np.ravel(share))


def html(result: "Result") -> str:
    """The picture, if the result has one, and the summary."""
    rows = summary(result)
    try:
        data = base64.b64encode(picture(result)).decode()
        image = f'<img alt="image" style="max-width:400px" src="data:image/png;base64,{data}">'
    except McrtError:
        image = ""
    return f"<div>{image}{table(rows)}</div>"


def _axes(ax: Any) -> Any:
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install matplotlib") from error
    return plt.subplots()[1] if ax is None else ax


def plot_image(
    result: "Result", camera: "Camera | None" = None, order: int | str | None = None, ax: Any = None
) -> Any:
    """Draw an image: tone-mapped where it is RGB, else linear with a colour bar."""
    image = result.image(camera, order)
    ax = _axes(ax)
    if image.ndim == 3:
        ax.imshow(tone_map(image))
    else:
        shown = ax.imshow(image, cmap="gray")
        ax.figure.colorbar(shown, ax=ax, label="radiance [W/(sr length²)]")
    ax.set_axis_off()
    return ax


def plot_slice(
    result: "Result",
    quantity: str = "fluence",
    axis: str = "z",
    index: int | None = None,
    log: bool = False,
    ax: Any = None,
) -> Any:
    """Draw a slice of a voxel array in world coordinates."""
    choice(
        "quantity", quantity, [name + suffix for name in QUANTITIES for suffix in ("", "_error")]
    )
    normal = "zyx".index(choice("axis", axis, ("x", "y", "z")))
    values = getattr(result, quantity)
    n = values.shape[normal]
    index = n // 2 if index is None else integer("index", index, -n, n - 1) % n
    plane = values.take(index, axis=normal)
    vertical, horizontal = (i for i in range(3) if i != normal)
    ends = box_ends(result)
    ax = _axes(ax)
    options: dict[str, Any] = {"origin": "lower", "extent": (*ends[horizontal], *ends[vertical])}
    if plane.ndim == 3:
        ax.imshow(tone_map(plane), **options)
    else:
        shown = ax.imshow(plane, norm="log" if log else "linear", **options)
        label = f"{quantity} [{QUANTITIES[quantity.removesuffix('_error')]}]"
        ax.figure.colorbar(shown, ax=ax, label=label)
    centre = ends[normal][0] + (index + 0.5) * result._scene["spacing"][normal]
    ax.set(
        xlabel="zyx"[horizontal], ylabel="zyx"[vertical], title=f"{quantity}, {axis} = {centre:.6g}"
    )
    return ax


def box_ends(result: "Result") -> list[tuple[float, float]]:
    """Lower and upper end of the box along z, y and x."""
    scene = result._scene
    lower = scene["origin"][::-1]
    counts = scene["density"].shape
    return [(a, a + n * d) for a, n, d in zip(lower, counts, scene["spacing"], strict=True)]


def show(result: "Result", camera: "Camera | None" = None) -> None:
    """Show the image in a window or in the notebook."""
    plot_image(result, camera)
    import matplotlib.pyplot as plt

    plt.show()
