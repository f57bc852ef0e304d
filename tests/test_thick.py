"""Random volumes, thin to thick: what their voxels absorb adds up to what the energy balance says.

200 scenes in turn by method, light and interpolation; what else they hold is drawn. False alarms:
1e-5 per test, of the scenes or groups of scenes together.
"""

import os
from dataclasses import dataclass

import comparing
import mcrt
import numpy as np
import pytest
from conftest import cached
from random_scenes import Chance

SCENES, LATTICES = 200, 8
PHOTONS = 200_000, 20_000  # where voxels are thin, and few collide; and where they are thick
BOUND = 0.002  # what sums of voxels may be off, beside noise
LIGHTS = ("outside", "far", "inside", "near a face", "on a face", "sun", "low sun", "pencil", "sky")
MEDIA = ("ones", "voids", "blocks", "ramp", "noise", "layers", "spike")


class Thick(Chance):
    """What is drawn for one scene; the sky has unscattered light of photons alone."""

    def __init__(self, number):
        super().__init__((11, number))
        turn, self.method = number // 2, ("single", "photon")[number % 2]
        kinds = LIGHTS[:-1] if self.method == "single" else LIGHTS
        self.kind = kinds[turn % len(kinds)]
        self.interpolation = ("nearest", "linear")[turn // len(kinds) % 2]

    def scene(self):
        rng = self.rng
        self.shape = tuple(int(n) for n in np.where(rng.random(3) < 0.1, 1, rng.integers(4, 13, 3)))
        self.spacing = np.array([self.log(1, 20) for _ in range(3)]) * self.log(0.1, 10)
        self.low = self.one(np.zeros(3), rng.uniform(-50, 50, 3))
        self.size = (np.array(self.shape) * self.spacing)[::-1]
        self.middle = self.low + self.size / 2
        self.medium, self.depth = self.one(*MEDIA), self.log(1e-3, 1e3)
        extinction = self.depth / np.prod(self.spacing) ** (1 / 3)
        # Colours where voxels are quick to cross: rays of light between centres take many steps.
        rgb = self.interpolation == "nearest" and rng.random() < 0.2
        albedo = self.one(0.6, 0.9, "voxels", 0.0 if self.method == "single" else 0.99)
        return {
            "volume": self.density(),
            "spacing": tuple(self.spacing),
            "origin": tuple(self.low),
            "interpolation": self.interpolation,
            "extinction": extinction * np.array([1.0, 0.5, 0.1]) if rgb else extinction,
            "albedo": rng.random(self.shape) if albedo == "voxels" else albedo,
            "light": self.light(self.kind),
            "method": self.method,
            "outputs": ("fluence",),
            "progress": False,
        }

    def value(self, high=1.0):
        """Grey lights: what is dark has no ratio."""
        return high

    def density(self):
        """Values up to 1."""
        rng, shape = self.rng, self.shape
        values, axis = rng.random(shape), rng.integers(3)
        along = [a for a in range(3) if a != axis]
        if self.medium == "ones":
            values[:] = 1
        elif self.medium == "voids":
            values = np.where(values < 0.6, 0, 1)
        elif self.medium == "blocks":
            few = rng.random([(n + 1) // 2 for n in shape])
            values = np.kron(few, np.ones((2, 2, 2)))[tuple(map(slice, shape))]
        elif self.medium == "ramp":
            values[:] = np.expand_dims(np.linspace(0, 1, shape[axis] + 1)[1:], along)
        elif self.medium == "layers":
            values[:] = np.expand_dims(10 ** -rng.uniform(0, 4, shape[axis]), along)
        elif self.medium == "spike":
            values *= 1e-3
        values[tuple(rng.integers(shape))] = 1
        return values.astype(np.float32)

    def light(self, kind):
        rng = self.rng
        if kind == "outside":
            return mcrt.PointLight(self.outside(), 10.0)
        if kind == "far":
            return mcrt.PointLight(self.outside(1e5), 1e6)
        if kind in ("near a face", "on a face"):
            # A face, an edge or a corner: on it, a hair beside it, or within a voxel beside it.
            hair = self.one(0.0, 1e-9, 1e-3) * self.size.min()
            place = self.low + self.size * rng.random(3)
            for axis in rng.permutation(3)[: self.one(1, 1, 2, 3)]:
                off = hair if kind == "on a face" else self.spacing[2 - axis] * rng.random()
                face = self.low[axis] + rng.integers(2) * self.size[axis]
                place[axis] = face + self.one(-1, 1) * off
            return mcrt.PointLight(tuple(place), 1.0)
        if kind == "low sun":
            mu0, turn = self.log(0.02, 0.3), rng.uniform(0, 2 * np.pi)
            across = np.sqrt(1 - mu0**2) * np.array([np.cos(turn), np.sin(turn)])
            direction = np.roll([self.one(-1, 1) * mu0, *across], rng.integers(3))
            return mcrt.DirectionalLight(tuple(direction), 1.0)
        if kind == "pencil":
            start = np.array(self.outside())
            return mcrt.PencilBeam(tuple(start), tuple(self.inside() - start), 1.0)
        return super().light(kind)

    def aimed(self, light):
        """The share of its power that a light's photons may carry: those of a point far enough
        outside fill the cone around the ball around the box."""
        if not isinstance(light, mcrt.PointLight):
            return 1.0
        radius = np.linalg.norm(self.size) / 2
        sine = radius / max(np.linalg.norm(self.middle - light.position), radius)
        return 0.5 * sine**2 / (1 + np.sqrt(1 - sine**2)) if sine < 1 else 1.0


# ------------------------------------------------------------------------------------------- runs


@dataclass
class Found:
    """A run, what its voxels absorb and what the balance says, as parts of the power launched."""

    thick: Thick
    energy: dict
    voxels: np.ndarray
    balance: np.ndarray
    error: np.ndarray  # of their difference: standard for lattices of rays, a guess for photons
    bound: np.ndarray  # of their difference, that one of all scenes exceeds once in 1e5 tests

    def __str__(self):
        t = self.thick
        return (
            f"{t.method}, {t.kind}, {t.interpolation}, {t.medium} of {t.shape}, depth {t.depth:.2g}"
            f", absorbed {self.balance}: off by {self.off}, bound {self.bound / self.balance}"
        )

    @property
    def off(self):
        return self.voxels / self.balance - 1


def find(number):
    thick = Thick(number)
    scene = thick.scene()
    photons = PHOTONS[thick.depth > 1]
    # Scenes have random numbers of their own, so that their noise is independent.
    scene["seed"] = number
    result = mcrt.simulate(**scene, photons=None if thick.method == "single" else photons)
    energy, launched = result.energy, np.atleast_1d(result.energy.launched)

    def whole(density):
        total = density.reshape(-1, len(launched)).sum(0, dtype=float)
        return total * np.prod(thick.spacing) / launched

    voxels, balance = whole(result.absorbed), np.atleast_1d(energy.absorbed)
    if thick.method == "single":
        # Errors of voxels may all have one sign.
        error = np.hypot(whole(result.absorbed_error), energy.absorbed_error)
        # Both have 7 degrees of freedom, and voxels come in single precision.
        bound = comparing.limit(SCENES, LATTICES - 1) * error + BOUND * balance
    else:
        each, most = thick.aimed(scene["light"]) / photons, np.maximum(voxels, balance)
        error = np.sqrt(3 * most * each)
        bound = bernstein(most, each) + BOUND * balance
    return Found(thick, energy, voxels, balance, error, bound)


def bernstein(share, each):
    """How far two means over photons, each of power `each`, may differ that estimate `share`.

    A photon that collides leaves up to 1 in the balance, and in voxels its way in free paths: of
    ways cut short somewhere E w^k <= k! E w, so that the moments of Bernstein's inequality are
    bounded by a variance of twice the mean and a scale of 1 (1 and 1/3 in the balance).
    """
    x = np.log(4 * SCENES / comparing.ALPHA) * each
    return sum(b * x + np.sqrt((b * x) ** 2 + 2 * x * v * share) for v, b in ((1, 1 / 3), (2, 1)))


@cached
def found():
    """All scenes; on the GPU a few of those with photons, for the rest is the host's."""
    on_gpu = os.environ["MCRT_BACKEND"] == "gpu"
    return [find(number) for number in (range(1, SCENES, 2) if on_gpu else range(SCENES))]


# ------------------------------------------------------------------------------------------ claims


def test_energies_of_random_thick_volumes_add_up():
    for one in found():
        comparing.assert_balance(one.energy)
        if one.thick.method == "single":
            assert not any(np.any(part) for part in one.energy.escaped.values()), one


def test_voxels_of_each_random_thick_volume_absorb_what_the_balance_says():
    wrong = [str(one) for one in found() if np.any(np.abs(one.voxels - one.balance) > one.bound)]
    assert not wrong, "\n".join([f"{len(wrong)} of {len(found())}", *wrong])


GROUPS = {
    "light": lambda thick: thick.kind,
    "interpolation": lambda thick: thick.interpolation,
    "medium": lambda thick: thick.medium,
    "depth": lambda thick: f"1e{np.floor(np.log10(thick.depth) / 2) * 2:.0f} and up",
}


@pytest.mark.cpu_only("a GPU has too few scenes to tell their kinds apart")
@pytest.mark.parametrize("by", GROUPS)
@pytest.mark.parametrize("method", ["single", "photon"])
def test_no_kind_of_thick_volume_is_biased(method, by):
    groups = {}
    for one in found():
        if one.thick.method == method:
            groups.setdefault(GROUPS[by](one.thick), []).append(one)
    for name, group in groups.items():
        # Grey, or the channel that absorbs most: channels share their photons.
        some = [(one, np.argmax(one.balance)) for one in group if one.balance.max() > 0]
        off = np.array([one.off[c] for one, c in some])
        error = np.array([one.error[c] / one.balance[c] for one, c in some])
        weight = 1 / (error**2 + 1e-8)
        mean = np.average(off, weights=weight)
        spread = np.sqrt((weight**2 * (off - mean) ** 2).sum()) / weight.sum()
        noise = comparing.limit(len(groups), len(off) - 1) * spread
        print(f"{name}: {mean:.1e} +- {spread:.1e}, of {len(off)}")
        assert abs(mean) < noise + 1e-5, (name, mean, spread)  # voxels are in single precision
