"""The table of comparisons with Mitsuba 3: cases, references, ours, and the test of equality.

A case is one value per axis of `AXES`. `covering(2)` and `covering(3)` are small sets of cases that
hold every valid pair, and every valid triple, of values.
"""

import hashlib
import itertools
import json
import os
import sys
import time
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import conftest  # noqa: F401
import drjit
import mcrt
import mitsuba as mi
import numpy as np
from covering import Table, subsets  # noqa: F401
from mitsuba_film import film_emitter
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


# ---------------------------------------------------------------------------------------- reference


def select_variant(rgb=True):
    """True: compiled by LLVM, of the version that `conftest` chose."""
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and drjit.has_backend(drjit.JitBackend.LLVM)
    mi.set_variant("scalar_rgb" if not llvm else "llvm_ad_rgb" if rgb else "llvm_ad_mono")
    return llvm


def translated(case):
    given = arguments(case)
    return mcrt.interop.to_mitsuba(given.pop("volume"), **given)


def grey_parts(case):
    """Scenes whose images are the channels of the case's, or None where it is rendered whole.

    `volpathmis` is skewed in deep chromatic media: at tau 30 a dark block had 20 to 35 % less than
    `volpath` has in grey media of the channels' extinctions, even after 60 x 512 samples a pixel.
    """
    if case["tau"] != "30" or case["colour"] != "rgb extinction" or case["light"] == "inside":
        return None
    given = arguments(case)
    volume = given.pop("volume")
    parts = ({**given, "extinction": float(one)} for one in given["extinction"])
    return [mcrt.interop.to_mitsuba(volume, **part) for part in parts]


def rendered(case, spp, seeds):
    """Images (seeds, h, w, c) of Mitsuba."""

    def images(scene):
        scene = mi.load_dict(scene)
        renders = [np.array(mi.render(scene, spp=spp, seed=seed)) for seed in range(seeds)]
        return np.stack(renders).astype(float)

    parts = grey_parts(case)
    if parts is None:
        return images(translated(case))
    return np.concatenate([images(part)[..., :1] for part in parts], -1)


def reciprocal(case, rays, seeds):
    """Features of a point light inside, by reciprocity: its intensity times the fluence, where it
    is, of the light that a block of the film sends along the camera's rays.

    `volpath` samples a point light by 1 / distance^2, whose variance is infinite where light
    scatters next to it (1 % of the image after 3 million paths, one block 20 %), and its shadow
    rays end short of it by 8.9e-4 of their length. Paths from the light to the film have neither.
    """
    import drjit as dr

    given = arguments(case)
    scene = translated(case)
    where = scene.pop("light0")["position"]
    plugin = film_emitter()
    scene["film"] = {"type": "film"}
    del scene["sensor"]
    integrator = mi.load_dict(scene.pop("integrator"))
    scene = mi.load_dict(scene)
    film, eye = plugin.last, given["camera"]
    forward = np.subtract(eye.target, eye.origin)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, eye.up)
    right /= np.linalg.norm(right)
    perspective = isinstance(eye, mcrt.PerspectiveCamera)
    half = np.tan(np.radians(eye.fov / 2)) if perspective else eye.width / 2
    film.aim(eye.origin, (right, np.cross(right, forward), forward), float(half), perspective)
    medium = scene.shapes()[0].interior_medium()
    width, height = RESOLUTION
    values = []
    for seed in range(seeds):
        blocks = []
        for top, bottom in itertools.pairwise(BLOCKS[0]):
            for left, end in itertools.pairwise(BLOCKS[1]):
                film.open(
                    (2 * left / width - 1, (height - 2 * bottom) / width),
                    (2 * end / width - 1, (height - 2 * top) / width),
                )
                sampler = mi.load_dict({"type": "independent"})
                sampler.seed(seed * 9 + len(blocks), rays)
                away = mi.warp.square_to_uniform_sphere(sampler.next_2d())
                ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*where), away))
                radiance = integrator.sample(scene, sampler, ray, medium)[0]
                blocks.append(4 * np.pi * np.array(dr.mean(radiance, axis=1)).ravel())
        values.append(blocks)
    values = np.array(values, float) * np.array(given["light"].intensity)
    shares = np.outer(*(np.diff(edges) / edges[-1] for edges in BLOCKS)).ravel()
    return np.concatenate([(values * shares[:, None]).sum(1, keepdims=True), values], 1)


def budget(case):
    """Samples per pixel (rays per block, for a light inside) and seeds of Mitsuba.

    Enough that 1 % of extinction is seen where tau is 3; a case takes a few seconds.
    """
    deep = case["tau"] == "30"
    thick = deep and case["volume"] != "homogeneous"
    if case["light"] == "inside":
        return {"1": 2048, "5": 1024, "all": 256}[case["orders"]] if deep else 8192, 24
    if deep and case["orders"] == "all" and not thick:
        return 512, 24
    if thick:
        return {"1": 1024, "5": 256, "all": 64}[case["orders"]], 24
    sharp = case["phase"] == "hg .9" and case["light"] in ("outside", "directional")
    return (8192 if sharp else 2048), 24


def name(case):
    return ", ".join(case.values())


CACHE = Path(__file__).parents[1] / "target" / "mitsuba-cache"


def digest(value):
    """Bytes that say what Mitsuba is given."""
    if isinstance(value, dict):
        return repr([(key, digest(value[key])) for key in sorted(value)])
    if isinstance(value, mi.VolumeGrid | mi.Bitmap):
        array = np.array(value)
        return hashlib.sha256(array.tobytes() + repr(array.shape).encode()).hexdigest()
    if isinstance(value, mi.ScalarTransform4f):
        return repr(np.array(value.matrix).tolist())
    return repr(value)


def reference(case, more=1):
    """Features (seeds, 10, channels) of Mitsuba, and its mean image (none for a light inside).

    Kept in target/mitsuba-cache under a hash of the scene as Mitsuba gets it, of the budget and of
    Mitsuba's version; the command that makes it anew is beside it.
    """
    select_variant()
    samples, seeds = budget(case)
    inside = case["light"] == "inside"
    scenes = grey_parts(case) or [translated(case)]
    parts = (*map(digest, scenes), more * samples, seeds, mi.__version__, mi.variant(), inside)
    stem = CACHE / hashlib.sha256(repr(parts).encode()).hexdigest()[:24]
    if stem.with_suffix(".npz").exists():
        with np.load(stem.with_suffix(".npz")) as file:
            return file["features"], file["image"]
    start = time.perf_counter()
    if inside:
        found, image = reciprocal(case, more * samples, seeds), np.zeros(0)
    else:
        images = rendered(case, more * samples, seeds)
        found, image = features(images), images.mean(0)
    CACHE.mkdir(parents=True, exist_ok=True)
    command = f"python {Path(__file__).name} {json.dumps(name(case))} {more}"
    about = {
        "command": command,
        "directory": "tests",
        "mitsuba": mi.__version__,
        "variant": mi.variant(),
        "samples": more * samples,
        "seeds": seeds,
        "seconds": round(time.perf_counter() - start, 2),
    }
    stem.with_suffix(".json").write_text(json.dumps(about, indent=1))
    np.savez(stem.with_suffix(".npz"), features=found, image=image)
    return found, image


# --------------------------------------------------------------------------------------------- ours

SEEDS = 16
PHOTONS = {"0.1": 1e5, "3": 1e5, "30": 3e4}


def zoomed(camera, times):
    return replace(camera, resolution=tuple(times * n for n in camera.resolution))


def block_means(image, times):
    """An image (h, w[, c]) of pixels `times` as wide, (h / times, w / times, c)."""
    h, w = (n // times for n in image.shape[:2])
    return image.reshape(h, times, w, times, -1).mean((1, 3), dtype=float)


def ours(case, more=1, wrong=lambda given: {}):
    """Features (seeds, 10, channels) of ours, and the mean image; `wrong`: what replaces arguments.

    `single` and `photon` integrate a pixel from a few rays: their pixels are means of smaller ones.
    Order 1 is the same whatever the seed, unless the light is an environment.
    """
    method, sky = case["method"], case["light"] in ("constant", "mapped")
    deep_sky = sky and case["tau"] == "30"
    refine = 1 if method == "path" else 7 if deep_sky else REFINE[case["tau"]]
    given = arguments(case, refine)
    given |= wrong(given)
    photons = {"photons": more * PHOTONS[case["tau"]]}
    fixed = method == "single" and not sky
    options = {
        "single": {} if fixed else photons,
        "photon": photons,
        "path": {"spp": more * SPP},
    }[method]
    fine = 32 if case["light"] == "inside" else 16
    images = []
    own = zlib.crc32(name(case).encode())  # the same seeds would make the cases' noise the same
    for seed in range(own, own + (1 if fixed else SEEDS)):
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
            images.append(image(fine))
        elif sky:
            images.append(image(4))
        else:
            if seed == own:
                first = image(fine, 1)
            images.append(first + image(4, "2+"))
    images = np.stack(images)
    return features(images), images.mean(0)


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
    """Welch's t of features (seeds, 10, channels), in units of the image's mean.

    Blocks that few of Mitsuba's paths reach (deep shadow beside a light inside) have a skewed
    distribution, of which the seeds tell neither mean nor variance: those of a relative error above
    `RARE` are not compared.
    """
    inside = case["light"] == "inside"
    scale = true[:, :1].mean(0)
    means, parts, weights = [], [], []
    for samples in (ours, true):
        n = len(samples)
        means.append(samples.mean(0) / scale)
        part = samples.var(0, ddof=1) / n / scale**2 if n > 1 else np.zeros_like(means[-1])
        parts.append(part)
        weights.append(part**2 / max(n - 1, 1))
    total = sum(parts)
    error = np.sqrt(total + ROUNDING**2)
    dof = np.divide(total**2, sum(weights), out=np.full_like(total, 1e6), where=total > 0)
    rare = parts[1] > (RARE * means[1]) ** 2
    if inside:
        rare |= true.max(0) == 0
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
    # The same of order 1, which falls off within 1 / 30 of the box.
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


if __name__ == "__main__":
    wanted, more = sys.argv[1], int(sys.argv[2])
    reference(dict(zip(AXES, wanted.split(", "), strict=True)), more)
