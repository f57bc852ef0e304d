"""What Mitsuba 3 makes of the cases of `mitsuba_cases`."""

import itertools
import os
from pathlib import Path

import conftest  # noqa: F401
import drjit
import mcrt
import mitsuba as mi
import mitsuba_cases as cases
import numpy as np
from mitsuba_film import film_emitter
from mitsuba_stored import Job, digest, estimate


def select_variant(rgb=True):
    """True: compiled by LLVM, of the version that `conftest` chose."""
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and drjit.has_backend(drjit.JitBackend.LLVM)
    mi.set_variant("scalar_rgb" if not llvm else "llvm_ad_rgb" if rgb else "llvm_ad_mono")
    return llvm


def translated(case):
    given = cases.arguments(case)
    return mcrt.interop.to_mitsuba(given.pop("volume"), **given)


def grey_parts(case):
    """Scenes whose images are the channels of the case's, or None where it is rendered whole.

    `volpathmis` is skewed in deep chromatic media: at tau 30 a dark block had 20 to 35 % less than
    `volpath` has in grey media of the channels' extinctions, even after 60 x 512 samples a pixel.
    """
    if case["tau"] != "30" or case["colour"] != "rgb extinction" or case["light"] == "inside":
        return None
    given = cases.arguments(case)
    volume = given.pop("volume")
    parts = ({**given, "extinction": float(one)} for one in given["extinction"])
    return [mcrt.interop.to_mitsuba(volume, **part) for part in parts]


def rendered(case, spp, seeds):
    """Images (seeds, h, w, c) of Mitsuba."""

    def images(scene):
        scene = mi.load_dict(scene)
        renders = [np.array(mi.render(scene, spp=spp, seed=seed)) for seed in seeds]
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

    given = cases.arguments(case)
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
    width, height = cases.RESOLUTION
    values = []
    for seed in seeds:
        blocks = []
        for top, bottom in itertools.pairwise(cases.BLOCKS[0]):
            for left, end in itertools.pairwise(cases.BLOCKS[1]):
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
    shares = np.outer(*(np.diff(edges) / edges[-1] for edges in cases.BLOCKS)).ravel()
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


CACHE = Path(__file__).parents[1] / "target" / "mitsuba-cache"


def job(case, more=1):
    """Mitsuba's features (seeds, 10, channels) of the case, with so many times the samples."""
    select_variant()
    samples, seeds = budget(case)
    scenes = grey_parts(case) or [translated(case)]
    return Job(
        f"{cases.name(case)}, {more}",
        digest(scenes, more * samples, seeds, mi.__version__),
        seeds,
        lambda some: render(case, more * samples, some)[0],
    )


def render(case, samples, seeds):
    """Features (seeds, 10, channels) of Mitsuba, and its mean image (none for a light inside)."""
    select_variant()
    if case["light"] == "inside":
        return reciprocal(case, samples, seeds), np.zeros(0)
    images = rendered(case, samples, seeds)
    return cases.features(images), images.mean(0)


def reference(case, more):
    """The estimate of Mitsuba's features, and its mean image; rendered once, kept in target/."""
    path = CACHE / f"{job(case, more).scene}.npz"
    if not path.exists():
        samples, seeds = budget(case)
        features, image = render(case, more * samples, range(seeds))
        CACHE.mkdir(parents=True, exist_ok=True)
        np.savez(path, features=features, image=image)
    with np.load(path) as file:
        return estimate(file["features"]), file["image"]
