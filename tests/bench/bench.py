"""How fast it is: `make bench` prints one table, each peer timed in the same run.

Errors are RMS differences from a converged run of another seed, the reference's noise taken off,
over the mean, both over the pixels above 5 % of the maximum (as target_error counts).
Mitsuba's time to an error is extrapolated from its measured variance, which falls as 1 / samples.
"""

import argparse
import resource
import subprocess
import sys
import time

import mcrt
import numpy as np

SIDE = 128
EXTINCTION = 0.1
LIGHT = mcrt.PointLight((200, -150, 300), 1e5)
EYE, CENTRE = (400, -300, 150), (64, 64, 64)


def camera(side, fov=20):
    return mcrt.PerspectiveCamera(EYE, CENTRE, fov=fov, resolution=(side, side))


def cloud_scene(view, **options):
    scene = {
        "extinction": EXTINCTION,
        "albedo": 0.9,
        "light": LIGHT,
        "max_scatterings": 5,
        "camera": view,
        "outputs": ("image",),
    }
    return scene | options


def timed(call, *arguments, **options):
    start = time.perf_counter()
    result = call(*arguments, **options)
    return result, time.perf_counter() - start


def relative_rms(image, reference, noise):
    """Relative RMS difference beyond the reference's noise, over the bright pixels."""
    bright = reference > 0.05 * reference.max()
    square = np.mean((image - reference)[bright] ** 2) - np.mean(noise[bright] ** 2)
    return np.sqrt(max(square, 0.0)) / reference[bright].mean()


def row(name, value, unit, note=""):
    print(f"{name:<52} {value:>10} {unit:<10} {note}", flush=True)


def bench_cloud():
    """The 128^3 trilinear cloud, 5 orders, within 1 %."""
    volume = mcrt.datasets.cloud(SIDE)
    view = camera(64)
    reference = mcrt.simulate(volume, **cloud_scene(view, photons=6e7, seed=99))
    truth, noise = reference.image(), reference.image_error()
    for photons in (5e5, 1.5e6):
        result, seconds = timed(mcrt.simulate, volume, **cloud_scene(view, photons=photons, seed=1))
        image, gather = timed(result.image)
        error = relative_rms(image, truth, noise)
        stages = result.stats["seconds"]
        row(f"cloud 64 x 64, {photons:.2g} photons: error", f"{100 * error:.2f}", "%")
        row("  light grid", f"{stages['light grid']:.2f}", "s")
        row("  photons", f"{stages['photons']:.2f}", "s")
        row("  gather", f"{gather:.2f}", "s")
        row("  in all", f"{seconds + gather:.2f}", "s")
    _, gather = timed(result.image, camera(600))
    row("cloud gather 600 x 600", f"{gather:.2f}", "s")
    return volume, view, truth, error, seconds + gather


def bench_mitsuba(volume, view, truth, error, ours):
    """The same image by Mitsuba's volpath on the same cores."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_mono")
    size = float(SIDE)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": 6, "rr_depth": 100000},
            "light": {"type": "point", "position": LIGHT.position, "intensity": 1e5},
            "sensor": {
                "type": "perspective",
                "fov": 20,
                "to_world": mi.ScalarTransform4f().look_at(EYE, CENTRE, (0, 0, 1)),
                "film": {
                    "type": "hdrfilm",
                    "width": 64,
                    "height": 64,
                    "rfilter": {"type": "box"},
                    "pixel_format": "luminance",
                },
                "sampler": {"type": "independent"},
            },
            "cube": {
                "type": "cube",
                "to_world": mi.ScalarTransform4f().scale(size / 2).translate([1, 1, 1]),
                "bsdf": {"type": "null"},
                "interior": {
                    "type": "heterogeneous",
                    "albedo": 0.9,
                    "scale": EXTINCTION,
                    "sigma_t": {
                        "type": "gridvolume",
                        "grid": mi.VolumeGrid(volume[..., np.newaxis]),
                        "to_world": mi.ScalarTransform4f().scale(size),
                        "accel": False,
                    },
                },
            },
        }
    )
    samples = 16

    def render(seed):
        return np.array(mi.render(scene, spp=samples, seed=seed))[..., 0]

    render(0)  # compiles
    images, seconds = timed(lambda: np.array([render(seed) for seed in range(1, 5)]))
    seconds /= len(images)
    bright = truth > 0.05 * truth.max()
    variance = images.var(0, ddof=1)[bright].mean() / truth[bright].mean() ** 2
    offset = images[:, bright].mean() / truth[bright].mean() - 1
    needed = seconds * variance / error**2
    row("Mitsuba volpath, 16 samples a pixel: error", f"{100 * np.sqrt(variance):.1f}", "%")
    row("  mean over that of mcrt", f"{100 * offset:+.2f}", "%")
    row(f"  extrapolated to {100 * error:.2f} %", f"{needed:.0f}", "s")
    row("  time ratio Mitsuba / mcrt", f"{needed / ours:.0f}", "x")


def head(side):
    """The MRI head on side^3 voxels (every voxel the nearest of the original)."""
    volume = mcrt.datasets.mni_head()
    volume = getattr(volume, "density", volume)
    index = [np.linspace(0, n - 1, side).round().astype(int) for n in np.shape(volume)]
    return np.ascontiguousarray(np.asarray(volume)[np.ix_(*index)])


def bench_seed():
    """The seed paper's job: 12 s on its GPU."""
    volume = head(SIDE)
    extinction = 0.1 / float(volume.max())

    def job():
        view = mcrt.PerspectiveCamera(EYE, CENTRE, fov=28, resolution=(600, 600))
        options = cloud_scene(view, extinction=extinction, photons=1e6)
        return mcrt.simulate(volume, **options).image()

    _, seconds = timed(job)
    row("1e6 paths of <= 5 scatterings, 128^3 head, 600 x 600", f"{seconds:.2f}", "s", "12 s there")


MEMORY = """
import resource, numpy as np, mcrt
n = {n}
volume = np.zeros((n, n, n), np.float32)
part = slice(n // 3, n // 2)
volume[part, part, part] = np.random.default_rng(0).random((n // 2 - n // 3,) * 3, dtype=np.float32)
before = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() // 1024
mcrt.simulate(volume, extinction=4 / n, albedo=0.9, max_scatterings=None, photons={photons},
              light=mcrt.PointLight((2 * n, -n, 3 * n), 1.0), errors=False)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print((after - before) * 1024 / n**3, after / 2**20)
"""


def bench_memory(n, photons):
    code = MEMORY.format(n=n, photons=photons)
    start = time.perf_counter()
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    per_voxel, total = map(float, out.stdout.split())
    note = f"peak {total:.2f} GiB, {time.perf_counter() - start:.0f} s"
    # One private copy of the input is in it: 4 bytes.
    row(f"memory above the input, {n}^3 with voxel errors", f"{per_voxel:.0f}", "B/voxel", note)


def bench_cube60():
    """MCX's cube60: photons per second with the fluence volume."""
    volume = np.ones((60, 60, 60), np.float32)
    result, seconds = timed(
        mcrt.simulate,
        volume,
        extinction=1.005,
        albedo=1 / 1.005,
        phase=mcrt.HenyeyGreenstein(0.01),
        light=mcrt.PencilBeam((30, 30, -1), (0, 0, 1), 1.0),
        interpolation="nearest",
        outputs=("fluence",),
        photons=2e6,
    )
    row("cube60, fluence", f"{2 / seconds:.2f}", "M/s", f"absorbed {result.energy.absorbed:.4f}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--large", action="store_true", help="also 512^3")
    parser.add_argument("--no-mitsuba", action="store_true")
    arguments = parser.parse_args()
    cloud = bench_cloud()
    if not arguments.no_mitsuba:
        bench_mitsuba(*cloud)
    bench_seed()
    bench_cube60()
    bench_memory(256, 1e6)
    if arguments.large:
        bench_memory(512, 1e6)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"peak memory of this process {peak:.2f} GiB")


if __name__ == "__main__":
    main()
