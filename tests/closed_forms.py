"""Truths of the half space and of the infinite medium, in closed form or as integrals of one
variable.
"""

import functools

import numpy as np
from scipy import integrate, optimize


def h_function(albedo, mu, nodes=200):
    """Chandrasekhar's H(mu): 1 / H = sqrt(1 - a) + a/2 int_0^1 t H(t) / (mu + t) dt."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    t, w = (x + 1) / 2, w / 2
    h = np.ones(nodes)
    for _ in range(2000):
        new = 1 / (np.sqrt(1 - albedo) + albedo / 2 * ((w * t * h) / (t[:, None] + t)).sum(-1))
        if np.abs(new - h).max() < 1e-14:
            break
        h = 0.5 * (h + new)
    return 1 / (
        np.sqrt(1 - albedo)
        + albedo / 2 * ((w * t * h) / (np.asarray(mu, float)[..., None] + t)).sum(-1)
    )


def half_space_reflection(albedo, mu0):
    """R(mu0) = 1 - sqrt(1 - a) H(mu0)."""
    return 1 - np.sqrt(1 - albedo) * h_function(albedo, mu0)


@functools.cache
def infinite_modes(c):
    """Rate and weight of the discrete mode; rates beyond 1 and weights of the continuum."""
    kappa = optimize.brentq(lambda k: c * np.arctanh(k) / k - 1, 1e-9, 1 - 1e-15)
    discrete = 2 * kappa**2 * (1 - kappa**2) / (c * (c - 1 + kappa**2))
    # In v = 1/mu - 1 on [0, inf): int_0^1 g(mu) exp(-r/mu) / mu^2 dmu = exp(-r) int g exp(-r v) dv.
    x, w = np.polynomial.legendre.leggauss(400)
    s, w = (x + 1) / 2, w / 2
    v, dv = (s / (1 - s)) ** 2, w * 2 * s / (1 - s) ** 3
    mu = 1 / (1 + v)
    atanh = 0.5 * np.log((2 + v) / np.maximum(v, 1e-300))
    g = 1 / ((1 - c * mu * atanh) ** 2 + (np.pi * c * mu / 2) ** 2)
    return kappa, discrete, v, g * dv


def infinite_fluence(r, c):
    """Fluence per watt at r [mean free paths] of an isotropic point source, isotropic scattering of
    albedo c (Case, de Hoffmann & Placzek 1953): one discrete mode, and an integral over exp(-r /
    mu)."""
    kappa, discrete, v, weight = infinite_modes(c)
    r = np.asarray(r, float)
    continuum = np.exp(-r) * (weight * np.exp(-r[..., None] * v)).sum(-1)
    return (discrete * np.exp(-kappa * r) + continuum) / (4 * np.pi * r)


def infinite_absorbed(radius, c):
    """Fraction of the power absorbed within a radius: (1 - c) int 4 pi r^2 Phi dr."""
    return (1 - c) * integrate.quad(
        lambda r: 4 * np.pi * r * r * infinite_fluence(r, c), 0, radius, epsabs=1e-10, limit=200
    )[0]


def moments(sigma_a, sigma_s, g1, g2):
    """<r^2>, <r^4> of absorption around a point source, for the phase's Legendre moments."""
    s0, s1, s2 = sigma_a, sigma_a + sigma_s * (1 - g1), sigma_a + sigma_s * (1 - g2)
    return 2 / (s0 * s1), 32 / (3 * s0 * s1**2 * s2) + 40 / (3 * s0**2 * s1**2)


def binned_moments(weight, h, centre):
    """<r^2> and <r^4> of a density summed over cubic voxels of side h, with Sheppard's corrections

    (a voxel's centre is the place plus an independent uniform offset): <r^2> = sum c^2 - h^2/4;
    <r^4> = sum c^4 - 5/6 h^2 <r^2> - 19/240 h^4.
    """
    z, y, x = (
        ((np.arange(n) + 0.5) * h - c) ** 2 for n, c in zip(weight.shape, centre[::-1], strict=True)
    )
    c2 = z[:, None, None] + y[:, None] + x
    r2 = (weight * c2).sum() / weight.sum() - h * h / 4
    return r2, (weight * c2**2).sum() / weight.sum() - 5 / 6 * h * h * r2 - 19 / 240 * h**4


def ball_overlap(shape, h, centre, radius, sub=8):
    """The share of each cubic voxel within a ball, and its first moment about the centre."""
    z, y, x = ((np.arange(n) + 0.5) * h - c for n, c in zip(shape, centre[::-1], strict=True))
    middle = np.stack(np.meshgrid(z, y, x, indexing="ij"), -1)
    distance = np.linalg.norm(middle, axis=-1)
    share, moment = (distance < radius).astype(float), np.zeros((3, *shape))
    cut = np.abs(distance - radius) < h * np.sqrt(3) / 2
    node = ((np.arange(sub) + 0.5) / sub - 0.5) * h
    offset = np.stack(np.meshgrid(node, node, node, indexing="ij"), -1).reshape(-1, 3)
    inside = np.linalg.norm(middle[cut][:, None, :] + offset, axis=-1) < radius
    share[cut] = inside.mean(-1)
    moment[:, cut] = (inside @ offset / sub**3).T
    return share, moment


def within_ball(field, h, centre, radius):
    """Integral over a ball of a field given by voxel means, with central-difference slopes."""
    low = [max(0, int((c - radius) / h) - 2) for c in centre[::-1]]
    high = [int((c + radius) / h) + 3 for c in centre[::-1]]
    field = field[tuple(map(slice, low, high))]  # the voxels that the ball reaches, and one more
    centre = [c - n * h for c, n in zip(centre, low[::-1], strict=True)]
    share, moment = ball_overlap(field.shape, h, centre, radius)
    slope = np.stack(np.gradient(field, h))
    return ((field * share + (slope * moment).sum(0)).sum()) * h**3
