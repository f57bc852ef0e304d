"""Random scenes, reproducible by number, through both backends with the same seed.

    python tests/random_scenes.py [COUNT] [FIRST]

Prints how many ran, how many differ beyond rounding, and the worst. Fails where a scene does,
and where most differ.

Images of thin voxels, linear between them, differ by more than rounding: the CPU sums them in even
steps (`src/backend/cpu/even.rs`), the GPU cell by cell.
"""

import sys
import time
from dataclasses import dataclass

import mcrt
import numpy as np

ROUNDING = 1e-4  # a difference (mean absolute over mean) beyond it means that a fate has flipped
FLIPPED = 0.05  # how far flips may take a scene, and three walks more
PARTS = ("missed", "unscattered", "absorbed", "truncated", "roulette")


# ------------------------------------------------------------------------------------------- scenes


def scene(number):
    """The arguments of `simulate` for a scene, but for the backend."""
    return Chance(number).scene()


class Chance:
    """What is drawn for one scene."""

    def __init__(self, number):
        self.rng = np.random.default_rng([2024, number])

    def one(self, *values, p=None):
        return values[self.rng.choice(len(values), p=p)]

    def log(self, low, high):
        """Uniform in the logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def value(self, high=1.0):
        """A number or RGB, now and then with zeros."""
        values = high * self.rng.random(3) * (self.rng.random(3) > 0.1)
        return tuple(map(float, values)) if self.rng.random() < 0.15 else float(values.max())

    def toward(self):
        """A direction, now and then along an axis."""
        if self.rng.random() < 0.25:
            return tuple(self.one(-1.0, 1.0) * np.eye(3)[self.rng.integers(3)])
        return tuple(self.rng.normal(size=3))

    def scene(self):
        rng = self.rng
        method = self.one("photon", "path", "single", "auto", p=(0.6, 0.28, 0.07, 0.05))
        self.shape = tuple(int(self.one(1, 2, rng.integers(3, 12))) for _ in range(3))
        self.spacing = np.array([self.log(0.3, 3) for _ in range(3)])
        self.low = self.one(np.zeros(3), rng.uniform(-50, 50, 3))
        self.size = (np.array(self.shape) * self.spacing)[::-1]
        self.middle = self.low + self.size / 2
        solid = rng.random() < 0.1
        media = self.solid() if solid else self.voxels()
        kinds = ["point", "far", "inside", "sun", "sky", "map"] + ["pencil"] * (method != "path")
        arguments = {
            **media,
            "light": [
                self.light(self.one(*kinds)) for _ in range(self.one(0, 1, 2, p=(0.1, 0.6, 0.3)))
            ],
            "method": method,
            "tracker": self.one("auto", "woodcock", "march", "analytic", p=(0.5, 0.2, 0.27, 0.03)),
            "max_scatterings": self.one(None, None, int(rng.integers(6))),
            "seed": int(rng.integers(2**64, dtype=np.uint64)),
            "errors": bool(rng.random() < 0.85),
            "camera": self.camera(),
            **self.effort(method),
        }
        if rng.random() < (0.4 if method == "photon" else 0.02):
            arguments["angular"] = self.one("sh", int(rng.integers(4)))
        if rng.random() < (0.8 if solid and method != "path" else 0.2):
            names = ("fluence", "radiance", "image") if method != "path" else ("image",)
            arguments["outputs"] = tuple(n for n in names if rng.random() < 0.6) or names[:1]
        return arguments

    def effort(self, method):
        """How many walks."""
        if method == "path" or (method == "auto" and self.rng.random() < 0.5):
            return {"spp": int(self.one(1, 8, 30, 100))}
        if method == "single":
            return {}
        if self.rng.random() < 0.1:
            return {"target_error": 0.2}
        return {"photons": int(self.log(30, 30_000))}

    def voxels(self):
        rng, shape = self.rng, self.shape
        kind = self.one(
            "ones", "noise", "gaps", "blob", "spike", "void", p=(0.22, 0.3, 0.2, 0.15, 0.1, 0.03)
        )
        density = rng.random(shape, dtype=np.float32)
        if kind == "ones":
            density[:] = 1
        elif kind == "gaps":
            density[rng.random(shape) < 0.7] = 0
        elif kind == "blob":
            at = np.stack(np.indices(shape), -1) - (np.array(shape) - 1) / 2
            density = np.exp(-(at**2).sum(-1) / 6).astype(np.float32)
        elif kind == "spike":
            density = 0 * density
            density[tuple(rng.integers(shape))] = 5
        elif kind == "void":
            density[:] = 0
        depth = self.log(0.2, 60) / self.size.mean() / max(density.mean(), 0.05)
        extinction = depth * np.array(
            self.one((1,), (1,), (1,), (1, 0.5, 0.2), (1, 1, 1), (0, 1, 2))
        )
        albedo = self.one(
            0.0, 0.9, 0.9, 0.99, 1.0, (0.99, 0.7, 0.2), (0.0, 1.0, 0.5), "voxels", "voxels"
        )
        if albedo == "voxels":
            albedo = np.clip(rng.random(shape, dtype=np.float32) * 1.6 - 0.3, 0, 1)
        if rng.random() < 0.03:
            extinction = np.zeros(1)
        return {
            "volume": density,
            "spacing": tuple(self.spacing),
            "origin": tuple(self.low),
            "interpolation": self.one("linear", "nearest"),
            "extinction": float(extinction[0]) if len(extinction) == 1 else tuple(extinction),
            "albedo": albedo,
            "phase": self.phase(),
            "emission": self.emission(),
        }

    def solid(self):
        """A box or a sphere without voxels."""
        common = {
            "extinction": self.value(self.log(0.05, 20) / self.size.min()),
            "albedo": self.one(0.0, 0.9, 1.0, (0.99, 0.7, 0.2)),
            "phase": self.phase(),
            "emission": self.one(None, None, self.value()),
        }
        if self.rng.random() < 0.5:
            medium = mcrt.Medium.box(self.size, origin=self.low, **common)
        else:
            medium = mcrt.Medium.sphere(self.size.min() / 2, center=self.middle, **common)
        return {"volume": medium}

    def phase(self):
        rng = self.rng
        kind = self.one("isotropic", "rayleigh", "hg", "table", p=(0.35, 0.15, 0.35, 0.15))
        if kind == "table":
            cosines = np.concatenate([[-1], np.sort(rng.uniform(-1, 1, 4)), [1]])
            return mcrt.TabulatedPhase(cosines, rng.random(6) * (rng.random(6) > 0.2) + 1e-3)
        if kind == "hg":
            return mcrt.HenyeyGreenstein(float(self.one(-0.8, 0.0, 0.3, 0.7, 0.95)))
        return mcrt.Isotropic() if kind == "isotropic" else mcrt.Rayleigh()

    def emission(self):
        rng = self.rng
        kind = self.one("none", "value", "grey", "rgb", p=(0.75, 0.09, 0.08, 0.08))
        if kind == "none":
            return None
        if kind == "value":
            return self.value()
        shape = self.shape if kind == "grey" else (*self.shape, 3)
        return (rng.random(shape) * (rng.random(shape) < 0.5)).astype(np.float32)

    def inside(self):
        return tuple(self.low + self.size * self.rng.uniform(0.02, 0.98, 3))

    def outside(self, far=3.0):
        direction = self.rng.normal(size=3)
        distance = self.rng.uniform(0.8, far) * np.linalg.norm(self.size)
        return tuple(self.middle + distance * direction / np.linalg.norm(direction))

    def light(self, kind):
        rng = self.rng
        if kind == "far":
            return mcrt.PointLight(self.outside(1e6), self.value(1e9))
        if kind == "point":
            return mcrt.PointLight(self.outside(), self.value(10))
        if kind == "inside":
            return mcrt.PointLight(self.inside(), self.value())
        if kind == "sun":
            return mcrt.DirectionalLight(self.toward(), self.value())
        if kind == "pencil":
            start, end = self.one(self.inside(), self.outside()), self.inside()
            direction = self.one(np.subtract(end, start), self.toward())
            return mcrt.PencilBeam(start, tuple(direction), self.value())
        if kind == "sky":
            return mcrt.EnvironmentLight(self.value())
        shape = (int(rng.integers(1, 9)), int(rng.integers(1, 17)), *self.one((), (), (3,)))
        texels = rng.random(shape) * (rng.random(shape) < 0.7)
        texels[tuple(rng.integers(shape))] = 30
        return mcrt.EnvironmentLight(texels.astype(np.float32))

    def camera(self):
        resolution = tuple(map(int, self.rng.integers(1, 13, 2)))
        eye = self.one(self.outside(), self.outside(), self.inside())
        target = self.one(self.inside(), tuple(np.add(eye, self.toward())), p=(0.92, 0.08))
        if self.rng.random() < 0.7:
            fov = float(self.one(5, 30, 90))
            return mcrt.PerspectiveCamera(eye, target, fov=fov, resolution=resolution)
        width = float(self.size.max() * self.log(0.2, 3))
        return mcrt.OrthographicCamera(eye, target, width=width, resolution=resolution)


# --------------------------------------------------------------------------------------- comparison


@dataclass
class Compared:
    """How the backends differ on one scene."""

    number: int
    refused: str = ""
    differ: float = 0.0  # largest mean absolute difference over the mean, of all arrays
    where: str = ""
    collisions: float = 0.0  # relative
    walks: float = 0.0
    even: bool = False  # whether the CPU sums images in even steps
    trouble: str = ""

    def __str__(self):
        text = f"scene {self.number}: {self.trouble or 'ok'}; {self.walks:.0f} walks; "
        if self.refused:
            return f"{text}refused: {self.refused}"
        text += f"{self.where} differs by {self.differ:.1e}, collisions by {self.collisions:.1e}"
        return text + (", even steps" if self.even else "")


def outcome(arguments, backend):
    try:
        return mcrt.simulate(**arguments, backend=backend, progress=False)
    except mcrt.McrtError as error:
        return error


def arrays(result):
    """Everything that a result holds, by name."""
    outputs, path = result._settings["outputs"], result.plan.method == "path"
    found = {}
    if "image" in outputs:
        found["image"] = result.image()
        found["order 1"] = result.image(order=1)
        found["background"] = result.image(order=0)
        found["emission"] = result.image(order="emission")
        found["alpha"] = result.alpha()
        if result._settings["errors"]:
            found["image_error"] = result.image_error()
    if not path:
        for name, output in (("fluence",) * 2, ("radiance",) * 2, ("absorbed", "fluence")):
            if output in outputs and result._data.get(output) is not None:
                found[name] = getattr(result, name)
                if result._settings["errors"]:
                    found[f"{name}_error"] = getattr(result, f"{name}_error")
        shares = {name: getattr(result.energy, name) for name in PARTS}
        shares |= {f"escaped {face}": part for face, part in result.energy.escaped.items()}
        found["energy"] = np.array([np.sum(part) for part in shares.values()])
    return found


def in_even_steps(arguments):
    """Whether a voxel's optical depth is at most 1/4, of a density that varies."""
    if not isinstance(density := arguments["volume"], np.ndarray) or np.ptp(density) == 0:
        return False
    depth = np.max(arguments["extinction"]) * density.max() * max(arguments["spacing"])
    return arguments["interpolation"] == "linear" and depth <= 0.25


def difference(a, b):
    """Mean absolute difference over the mean."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    known = np.isfinite(a) & np.isfinite(b)  # a single batch leaves the errors unknown: infinite
    gap = np.abs(a[known] - b[known])
    return gap.mean() / np.abs(a[known]).mean() if gap.any() else 0.0


def compare(number):
    """One scene on both backends."""
    arguments = scene(number)
    cpu, gpu = (outcome(arguments, backend) for backend in ("cpu", "gpu"))
    refused = [str(one) if isinstance(one, Exception) else "" for one in (cpu, gpu)]
    found = Compared(number, refused[0])
    if any(refused) or type(cpu) is not type(gpu):
        if refused[0] != refused[1] or type(cpu) is not type(gpu):
            found.trouble = (
                f"CPU {type(cpu).__name__} {cpu!s:.200}, GPU {type(gpu).__name__} {gpu!s:.200}"
            )
        return found
    here, there = arrays(cpu), arrays(gpu)
    found.even, found.walks = in_even_steps(arguments), float(gpu.stats.photons)
    collisions = [float(result.stats.collisions) for result in (cpu, gpu)]
    found.collisions = abs(collisions[0] - collisions[1]) / max(collisions[0], 1)
    found.trouble = trouble(cpu, gpu, here, there)
    if found.trouble:
        return found
    for name in here:
        differ = difference(here[name], there[name])
        if differ > found.differ or not found.where:
            found.differ, found.where = differ, name
    if found.differ > FLIPPED + (3 / found.walks if found.walks else 0):
        found.trouble = "too different"
    return found


def trouble(cpu, gpu, here, there):
    """What must not be, whatever flips."""
    if here.keys() != there.keys():
        return f"arrays {set(here) ^ set(there)}"
    for name in here:
        if here[name].shape != there[name].shape or here[name].dtype != there[name].dtype:
            return f"shape or dtype of {name}"
        if not np.array_equal(np.isfinite(here[name]), np.isfinite(there[name])):
            return f"{name} is finite elsewhere"
        if not name.endswith("error") and not np.isfinite(there[name]).all():
            return f"{name} is not finite"
    if cpu.stats.photons != gpu.stats.photons:
        return f"{cpu.stats.photons} and {gpu.stats.photons} walks"
    if cpu.plan.method == "path":
        return ""
    launched = [np.asarray(result.energy.launched, float) for result in (cpu, gpu)]
    if not np.allclose(*launched, rtol=1e-6):
        return f"launched {launched}"
    for name, result in (("CPU", cpu), ("GPU", gpu)):
        lacks = np.abs(result.energy.sum() - 1.0) * (launched[0] > 0)
        if np.any(lacks > 1e-5 + 12 * np.asarray(result.energy.error)):
            return f"energy of the {name} lacks {lacks}, error {result.energy.error}"
    return ""


def main(count=25, first=0):
    start, found = time.perf_counter(), []
    for number in range(first, first + count):
        one = compare(number)
        found.append(one)
        if one.trouble or one.differ > ROUNDING:
            print(one, flush=True)
    print(summary(found, time.perf_counter() - start))
    return not well(found)


def well(found):
    """No scene fails, and most of them differ by rounding alone."""
    differ = [one.differ for one in found if not one.refused]
    return not any(one.trouble for one in found) and np.median(differ) < ROUNDING / 10


def summary(found, seconds):
    ran = [one for one in found if not one.refused]
    beyond = [one for one in ran if one.differ > ROUNDING]
    even = sum(one.even for one in beyond)
    median = np.median([one.differ for one in ran])
    lines = [
        f"{len(found)} scenes in {seconds / 60:.1f} minutes: {len(ran)} ran, "
        f"{len(found) - len(ran)} were refused, {sum(bool(one.trouble) for one in found)} failed",
        f"{len(beyond)} differ beyond rounding ({ROUNDING:.0e}), {even} of them by even steps; "
        f"the median is {median:.1e}, the worst are",
        *map(str, sorted(ran, key=lambda one: -one.differ)[:5]),
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
