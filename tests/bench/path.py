"""The path tracer against Mitsuba's `volpath` (`llvm_ad_mono`): figures of merit of four scenes.

The figure of merit is 1 / (R^2 T). R is the RMS standard error of a pixel over the mean, both over
the pixels above 5 % of the maximum, from the variance among independent seeds. T is processor
seconds over cores, which other load on the machine hardly disturbs and which on an idle one are the
seconds that pass. mcrt's R is 2 %, its default, and T that of the whole call, light grid and all.
Mitsuba's are those of its launches, without loading and compiling the scene, at the samples per
launch that it does fastest.

The samples of one R and T are those of every pixel, of those that see nothing too.
"""

from typing import NamedTuple

import cloud
import mcrt
import numpy as np
from mcrt.__main__ import tissue
from peers import MissingPeerError, mitsuba, mitsuba_scene
from table import busy, heading, number, row, timed

SIDE, ORDERS = 64, 5
GOAL, PILOT = 0.02, 256  # mcrt's R, and the samples per pixel that tell what it takes
CALLS, SECONDS = (4, 16), 40.0  # how many such calls, and their seconds in all
BUDGET, LAUNCHES = 12.0, range(8, 129)  # Mitsuba's: seconds in all, and how many
PER_LAUNCH, LONGEST = (16, 64, 256), 3.0  # samples per pixel; seconds of one launch


def scene(volume, eye, light, **options):
    """A volume of unit voxels seen by a square camera that looks at its centre."""
    nz, ny, nx = volume.shape
    arguments = {
        "albedo": 0.9,
        "light": mcrt.PointLight(light, 1e5),
        "max_scatterings": ORDERS,
        "camera": mcrt.PerspectiveCamera(
            eye, (nx / 2, ny / 2, nz / 2), fov=20, resolution=(SIDE, SIDE)
        ),
        "outputs": ("image",),
        "progress": False,
    }
    return volume, arguments | options


def homogeneous():
    """A cube of optical thickness 5."""
    n = 32
    return scene(np.ones((n,) * 3, np.float32), (100, -75, 37), (50, -37, 75), extinction=5 / n)


def clouds():
    return cloud.volume(), cloud.scene(cloud.camera(SIDE))


def spiky():
    """Haze of optical thickness 0.5 and 131 voxels of 15.6: the majorant is 1000 means."""
    n, spikes = 64, 131
    density = np.full(n**3, 0.5, np.float32)
    places = np.random.default_rng(0).choice(n**3, spikes, replace=False)
    density[places] = 1000.0
    return scene(
        density.reshape(n, n, n),
        (200, -150, 75),
        (100, -75, 150),
        extinction=1 / n,
        interpolation="nearest",
    )


def head():
    """The demo's MRI head, all its voxels: optical thickness 9 to 13 through the middle."""
    density = np.asarray(tissue().density)
    return scene(
        density,
        (322, 243, 120),
        (202, -69, 300),
        extinction=0.13,
        phase=mcrt.HenyeyGreenstein(0.6),
    )


SCENES = {"homogeneous": homogeneous, "cloud": clouds, "spiky": spiky, "head": head}


class Runs(NamedTuple):
    """Images of independent seeds (seeds, height, width), each of `samples` per pixel.

    `seconds` is the T of one, `passed` what a clock showed.
    """

    images: np.ndarray
    samples: int
    seconds: float
    passed: float = np.nan

    def rate(self):
        """Samples of all pixels together per second."""
        return self.samples * self.images[0].size / self.seconds

    def variance(self, bright):
        """Of a pixel of one image."""
        return self.images.var(0, ddof=1)[bright].mean()

    def spread(self, bright):
        """Relative standard deviation of one sample."""
        return np.sqrt(self.variance(bright) * self.samples) / self.images[:, bright].mean()

    def merit(self, bright):
        return self.rate() / self.spread(bright) ** 2


def repeated(render, samples, seeds):
    """`render(samples, seed)` of each seed."""
    runs = [timed(busy, render, samples, seed) for seed in seeds]
    images = np.array([image for (image, _), _ in runs], float)
    seconds = np.mean([seconds for (_, seconds), _ in runs])
    return Runs(images, samples, seconds, np.mean([passed for _, passed in runs]))


def ours(volume, options):
    """Images, and the mean of their own squared standard errors."""
    errors = []

    def render(samples, seed):
        result = mcrt.simulate(volume, **options, method="path", spp=samples, seed=seed)
        errors.append(result.image_error())
        return result.image()

    render(PILOT, 0)  # warms up
    pilot, seconds = busy(mcrt.simulate, volume, **options, method="path", spp=PILOT)
    errors.clear()
    more = (pilot.stats.relative_error / GOAL) ** 2
    calls = int(np.clip(SECONDS / (seconds * more), *CALLS))
    samples = max(round(PILOT * more), 4)
    runs = repeated(render, samples, range(1, calls + 1))
    return runs, np.mean(np.square(errors, dtype=float), axis=0)


def theirs(mi, volume, options):
    loaded = mi.load_dict(mitsuba_scene(mi, volume, options))

    def render(samples, seed):
        return np.array(mi.render(loaded, spp=samples, seed=seed))[..., 0]

    best = None
    for samples in PER_LAUNCH:
        render(samples, 0)  # compiles
        pilot = repeated(render, samples, (0, 0))
        if best is None or pilot.rate() > best.rate():
            best = pilot
        if pilot.seconds * PER_LAUNCH[1] / PER_LAUNCH[0] > LONGEST:
            break
    launches = int(np.clip(BUDGET / best.seconds, LAUNCHES[0], LAUNCHES[-1]))
    return repeated(render, best.samples, range(1, launches + 1))


def difference(one, other):
    """Of the images' means: relative, and in standard errors."""
    means = [runs.images.mean((1, 2)) for runs in (one, other)]
    error = np.sqrt(sum(mean.var(ddof=1) / len(mean) for mean in means))
    offset = means[0].mean() - means[1].mean()
    return offset / means[1].mean(), offset / error


def beyond_noise(one, other, bright):
    """Mean squared difference of pixels over what the noise of both makes it: 1 if they agree."""
    square = np.mean((one.images.mean(0) - other.images.mean(0))[bright] ** 2)
    return square / sum(runs.variance(bright) / len(runs.images) for runs in (one, other))


def compare(mi, name):
    volume, options = SCENES[name]()
    path, squares = ours(volume, options)
    volpath = theirs(mi, volume, options)
    mean = path.images.mean(0)
    bright = mean > 0.05 * mean.max()
    offset, sigma = difference(path, volpath)
    rates = {"mcrt": path, "Mitsuba": volpath}
    for code, runs in rates.items():
        note = f"{1e6 / runs.rate():.3g} us each; {len(runs.images)} x {runs.samples} per pixel"
        note += f"; T is {runs.seconds / runs.passed:.2f} of the seconds that passed"
        row(f"{name}, {code}", number(runs.rate() / 1e6), "M samples/s", note)
    claimed = np.sqrt(squares[bright].mean() / path.variance(bright))
    note = f"image_error() is {claimed:.2f} of it"
    row("  standard deviation of a sample, mcrt", f"{path.spread(bright):.3f}", "", note)
    row("  standard deviation of a sample, Mitsuba", f"{volpath.spread(bright):.3f}")
    chi = beyond_noise(path, volpath, bright)
    note = f"{sigma:+.1f} sigma; pixels' squared differences {chi:.2f} of the noise's"
    row("  mcrt's mean from Mitsuba's", f"{100 * offset:+.2f}", "%", note)
    ratio = path.merit(bright) / volpath.merit(bright)
    row("  figure of merit, mcrt over Mitsuba", number(ratio), "x")


def run(large=False):
    heading(f"path against Mitsuba volpath: four scenes, {ORDERS} orders, {SIDE} x {SIDE}")
    try:
        mi = mitsuba()
    except MissingPeerError as error:
        row("Mitsuba", "MISSING", "", f"NOT COMPARED: {error}")
        return
    for name in SCENES:
        compare(mi, name)
