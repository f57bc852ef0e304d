"""The table of comparisons with Mitsuba 3: cases, ours, and the test of equality.

A case is one value per axis of `AXES`. `covering(2)` and `covering(3)` are small sets of cases that
hold every valid pair, and every valid triple, of values.
"""

import itertools
import zlib
from dataclasses import dataclass, replace

import conftest  # noqa: F401
import mcrt
import numpy as np
from covering import Table, subsets  # noqa: F401
from mitsuba_stored import estimate
from scipy import stats

AXES = {
    "method": ("single", "photon", "path"),
    "tracker": ("woodcock", "march", "analytic"),
    "volume": ("homogeneous", "nearest", "linear"),
    "phase": ("isotropic", "rayleigh", "hg -.5", "hg .3", "hg .9", "tabulated"),
    "light": ("outside", "inside", "directional", "constant", "mapped"),
    "orders": ("1", "5", "all"),
    "colour": ("grey", "rgb albedo", "rgb extinction"),
    "albedo": ("0.2", "0.9", "1"),
    "tau": ("0.1", "3", "30"),
    "view": ("perspective", "orthographic", "anisotropic"),
}
IMPOSSIBLE = (  # combinations that no case has
    {"method": ("single",), "orders": ("5", "all")},  # holds order 1
    {"tracker": ("analytic",), "volume": ("nearest", "linear")},
    {"tracker": ("analytic",), "colour": ("rgb extinction",)},
)


TABLE = Table(AXES, IMPOSSIBLE)
possible, combinations, covering = TABLE.possible, TABLE.combinations, TABLE.covering


# ------------------------------------------------------------------------------------------- scenes

SHAPE, ORIGIN = (8, 7, 6), np.array((2.0, -3.0, 1.0))
LENGTH = 7.0  # of the box, about; where tau is measured
RESOLUTION = 12, 10
BLOCKS = (0, 3, 7, 10), (0, 4, 8, 12)  # edges of rows and of columns
PHASES = {
    "isotropic": mcrt.Isotropic(),
    "rayleigh": mcrt.Rayleigh(),
    "tabulated": mcrt.TabulatedPhase((-1, -0.5, 0, 0.5, 1), (0.6, 0.2, 0.5, 0.4, 1.6)),
}
RGB = {"rgb albedo": (1.0, 0.75, 0.5), "rgb extinction": (1.0, 0.7, 0.5)}
BLOBS = [  # x, y, z of the centre and radius, in extents of the box; weight
    (0.30, 0.35, 0.35, 0.40, 0.9),
    (0.70, 0.65, 0.50, 0.45, 0.8),
    (0.85, 0.25, 0.85, 0.50, 0.7),
    (0.15, 0.80, 0.95, 0.40, 0.6),
]


def density(kind):
    """Mean 1; blobs several voxels wide, some cut by the border, voids between; no symmetry."""
    if kind == "homogeneous":
        return np.ones(SHAPE, np.float32)
    z, y, x = np.meshgrid(*((np.arange(n) + 0.5) / n for n in SHAPE), indexing="ij")
    total = sum(
        weight * np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius**2)
        for cx, cy, cz, radius, weight in BLOBS
    )
    total = np.clip(total - 0.3, 0, None)
    return (total / total.mean()).astype(np.float32)


def refined(density, times, kind):
    """The same medium in voxels that are an odd number of times smaller.

    Old centres are new centres, so what is linear between the old ones is so between the new.
    """
    if kind != "linear":
        for axis in range(3):
            density = np.repeat(density, times, axis)
        return density
    for axis in range(3):
        n = density.shape[axis]
        at = np.clip((np.arange(n * times) + 0.5) / times - 0.5, 0, n - 1)
        low = np.minimum(at.astype(int), n - 2)
        f = (at - low).reshape([-1 if a == axis else 1 for a in range(3)])
        density = (1 - f) * np.take(density, low, axis) + f * np.take(density, low + 1, axis)
    return density.astype(np.float32)


def arguments(case, refine=1):
    """What `simulate` takes to describe the case's scene; the first is the volume."""
    spacing = np.array((0.75, 1.1, 1.3) if case["view"] == "anisotropic" else (1.0, 1.0, 1.0))
    size = np.multiply(SHAPE, spacing)[::-1]
    extinction, albedo = float(case["tau"]) / LENGTH, float(case["albedo"])
    ratio = RGB.get(case["colour"], 1.0)
    kind = case["volume"]
    return {
        "volume": refined(density(kind), refine, kind),
        "spacing": tuple(spacing / refine),
        "origin": tuple(ORIGIN),
        "interpolation": "linear" if kind == "linear" else "nearest",
        "extinction": np.multiply(extinction, ratio) if "ext" in case["colour"] else extinction,
        "albedo": np.multiply(albedo, ratio) if "albedo" in case["colour"] else albedo,
        "phase": phase(case["phase"]),
        "light": light(case["light"], size),
        "camera": camera(case["view"], size),
        "max_scatterings": None if case["orders"] == "all" else int(case["orders"]),
    }


def phase(name):
    return PHASES.get(name) or mcrt.HenyeyGreenstein(float(name.split()[1]))


def light(name, size):
    return {
        "outside": lambda: mcrt.PointLight(ORIGIN + size * (2.3, -0.4, 1.9), 300.0),
        "inside": lambda: mcrt.PointLight(ORIGIN + size * (0.31, 0.1, 0.59), 10.0),
        "directional": lambda: mcrt.DirectionalLight((-0.6, 0.35, -0.7), 2.0),
        "constant": lambda: mcrt.EnvironmentLight(1.0),
        "mapped": lambda: mcrt.EnvironmentLight(sky()),
    }[name]()


def sky():
    """A coarse map without symmetry, the brightest texel 20 times the mean."""
    values = np.random.default_rng(3).random((4, 8), dtype=np.float32)
    values[1, 2] = 10.0
    return values


def camera(view, size):
    centre = ORIGIN + size * (0.52, 0.47, 0.49)
    eye = centre + 28.0 * np.array((-0.42, -0.8, 0.43))
    if view == "orthographic":
        return mcrt.OrthographicCamera(eye, centre, width=13.0, resolution=RESOLUTION)
    return mcrt.PerspectiveCamera(eye, centre, fov=27.0, resolution=RESOLUTION)


def name(case):
    return ", ".join(case.values())


# ----------------------------------------------------------------------------------------- features


def features(images):
    """Means (n, 10, channels) over the image and over 3 x 3 blocks of images (n, h, w[, c])."""
    images = np.asarray(images, float)
    if images.ndim == 3:
        images = images[..., np.newaxis]
    zooms = (n // m for n, m in zip(images.shape[1:3], RESOLUTION[::-1], strict=True))
    rows, columns = (np.multiply(e, z) for e, z in zip(BLOCKS, zooms, strict=True))
    blocks = [
        images[:, a:b, c:d].mean((1, 2))
        for a, b in itertools.pairwise(rows)
        for c, d in itertools.pairwise(columns)
    ]
    return np.stack([images.mean((1, 2)), *blocks], 1)


# --------------------------------------------------------------------------------------------- ours

SEEDS = {"photon": 8, "sky": 16, "path": 16}
PHOTONS = {"0.1": 1e5, "3": 1e5, "30": 3e4}


def zoomed(camera, times):
    return replace(camera, resolution=tuple(times * n for n in camera.resolution))


def block_means(image, times):
    """An image (h, w[, c]) of pixels `times` as wide, (h / times, w / times, c)."""
    h, w = (n // times for n in image.shape[:2])
    return image.reshape(h, times, w, times, -1).mean((1, 3), dtype=float)


def ours(case, more=1, wrong=lambda given: {}):
    """The estimate of our features, and the mean image; `wrong`: what replaces arguments.

    `single` and `photon` integrate a pixel from a few rays: their pixels are means of smaller ones.
    Order 1 is the same whatever the seed, unless the light is an environment.
    """
    method, sky = case["method"], case["light"] in ("constant", "mapped")
    deep_sky = sky and case["tau"] == "30"
    refine = 1 if method == "path" else 7 if deep_sky else REFINE[case["tau"]]
    given = arguments(case, refine)
    given |= wrong(given)
    photons = {"photons": more * PHOTONS[case["tau"]]}
    fixed = method != "path" and case["orders"] == "1" and not sky
    if method == "path":
        options = {"spp": more * SPP}
    else:
        options = {} if fixed and method == "single" else photons
    count = 1 if fixed else SEEDS["sky" if sky else method]
    fine = 32 if case["light"] == "inside" else 16
    images = []
    own = zlib.crc32(name(case).encode())  # the same seeds would make the cases' noise the same
    for seed in range(own, own + count):
        result = mcrt.simulate(
            **given,
            method=method,
            tracker=case["tracker"],
            seed=seed,
            errors=False,
            outputs=["image"],
            progress=False,
            **options,
        )

        def image(times, order=None, result=result):
            return block_means(result.image(zoomed(given["camera"], times), order), times)

        if method == "path":
            images.append(block_means(result.image(), 1))
        elif fixed:
            images.append(image(fine, 1))
        elif sky:
            images.append(image(4))
        else:
            if seed == own:
                first = image(fine, 1)
            images.append(first + image(4, "2+"))
    images = np.stack(images)
    return estimate(features(images)), images.mean(0)


REFINE = {"0.1": 3, "3": 3, "30": 5}  # voxels per voxel and axis, odd
SPP = 1024
VALIDATE = 2  # times the samples, where every triple is compared

# --------------------------------------------------------------------------------------- comparison

ALPHA = 1e-3  # false-alarm probability of all comparisons of a table together


@dataclass(frozen=True)
class Comparison:
    """z-scores (10, channels), normal deviates of the same probability as Welch's t."""

    difference: np.ndarray  # relative to the image's mean
    error: np.ndarray
    dof: np.ndarray
    allowance: np.ndarray

    @property
    def t(self):
        beyond = np.abs(self.difference) - self.allowance
        return np.sign(self.difference) * np.maximum(beyond, 0) / self.error

    @property
    def p(self):
        """Two-sided probabilities, beyond the allowance."""
        return 2 * stats.t.sf(np.abs(self.t), self.dof)

    @property
    def z_beyond(self):
        return deviate(self.t, self.dof)

    @property
    def z(self):
        """Without the allowance: N(0, 1) if there is no bias."""
        z = deviate(self.difference / self.error, self.dof)
        return z[np.isfinite(self.error)]

    def __str__(self):
        block, channel = np.unravel_index(np.argmin(self.p), self.p.shape)
        parts = (self.difference, self.error, self.allowance)
        d, e, a = (100 * part[block, channel] for part in parts)
        return f"{d:+.2f} +- {e:.2f} % of the image's mean (allowed {a:.2f}), block {block}"


def deviate(t, dof):
    """The normal deviate of the same probability as Student's t."""
    p = np.maximum(stats.t.sf(np.abs(t), dof), 1e-300)
    return np.sign(t) * stats.norm.isf(p)


def compare(case, ours, true):
    """Welch's t of two estimates of features (10, channels), in units of the image's mean.

    Blocks that few of Mitsuba's paths reach (deep shadow beside a light inside) have a skewed
    distribution, of which the seeds tell neither mean nor variance: those of a relative error above
    `RARE` are not compared.
    """
    scale = true.mean[:1]
    means, parts, weights = [], [], []
    for side in (ours, true):
        means.append(side.mean / scale)
        parts.append(side.variance / scale**2)
        weights.append(parts[-1] ** 2 / max(side.count - 1, 1))
    total = sum(parts)
    error = np.sqrt(total + ROUNDING**2)
    dof = np.divide(total**2, sum(weights), out=np.full_like(total, 1e6), where=total > 0)
    rare = parts[1] > (RARE * means[1]) ** 2
    if case["light"] == "inside":
        rare |= true.mean == 0
    error[rare] = np.inf
    return Comparison(
        means[0] - means[1], error, dof, allowance(case) * np.maximum(means[1], FLOOR)
    )


ROUNDING = 5e-5  # of the image's mean: single precision in both
RARE = 0.15
FLOOR = 0.1  # of the image's mean, what darker blocks are measured by


ALLOWED = {  # relative bias, by tau; `path` has none
    "path": {"0.1": 0.0, "3": 0.0, "30": 0.0},
    # Quadrature along the view and the light rays.
    "single": {"0.1": 0.001, "3": 0.002, "30": 0.005},
    # Fluence interpolated between voxels of depth tau / 35 (0.1, 3: / 21): falls with its square.
    "photon": {"0.1": 0.001, "3": 0.005, "30": 0.02},
    # The same of order 1, which falls off as exp(-depth) from the box's faces: voxels of depth h
    # have averages h^2 / 24 too large and lines between them up to h^2 / 8: 12 % at tau 30, h .86.
    "environment": {"0.1": 0.002, "3": 0.01, "30": 0.11},
}


def allowance(case):
    """Bias of ours that is allowed, relative to the block, or to `FLOOR` where that is more."""
    sky = case["light"] in ("constant", "mapped")
    return ALLOWED["environment" if sky and case["method"] != "path" else case["method"]][
        case["tau"]
    ]


def level(cases):
    """The probability that one comparison of a table must exceed (Sidak)."""
    count = sum(10 * (1 if case["colour"] == "grey" else 3) for case in cases)
    return 1 - (1 - ALPHA) ** (1 / count)
