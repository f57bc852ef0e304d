"""Truths that the tests compare with (`comparing` does that).

Everything here is closed form or quadrature; nothing uses the package but `View.camera`. World
points are `(x, y, z)`, arrays and spacings `(z, y, x)`. Boxes have their lower corner at the
origin.
"""

import itertools
from dataclasses import dataclass

import numpy as np

# --------------------------------------------------------------------------- phase functions [1/sr]


def isotropic(cos_theta):
    return np.full_like(np.asarray(cos_theta, float), 1 / (4 * np.pi))


def rayleigh(cos_theta):
    return 3 / (16 * np.pi) * (1 + np.square(cos_theta))


def hg(g):
    return lambda cos_theta: (
        (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.asarray(cos_theta, float)) ** 1.5)
    )


# ----------------------------------------------------------------------------------------- geometry


def box_interval(origin, direction, size):
    """Distances (near >= 0, far) along rays in the box [0, size]; near >= far: a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (0 - origin) / direction, (np.asarray(size, float) - origin) / direction
    parallel = direction == 0
    inside = (origin >= 0) & (origin <= size)
    near = np.where(parallel, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
    far = np.where(parallel, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
    near, far = np.maximum(near.max(-1), 0), far.min(-1)
    return np.where(np.isfinite(near), near, 0), np.where(np.isfinite(near), far, -1)


def solid_angle(point, size):
    """Solid angle [sr] of the box [0, size] from a point outside: sum over the faces that the point
    sees.

    A face seen from height d above the corner of an a x b rectangle fills atan(a b / (d sqrt(a^2 +
    b^2 + d^2))).
    """
    total = 0.0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for height in (-point[axis], point[axis] - size[axis]):
            if height > 0:
                for su, a in ((1, size[u] - point[u]), (-1, -point[u])):
                    for sv, b in ((1, size[v] - point[v]), (-1, -point[v])):
                        total += (
                            su
                            * sv
                            * np.arctan(a * b / (height * np.sqrt(a * a + b * b + height * height)))
                        )
    return total


def surface(size):
    x, y, z = size
    return 2 * (x * y + y * z + z * x)


def mean_chord(size):
    """Mean path length of light that enters by Lambert's law, whatever scatters it: 4 V / S."""
    return 4 * np.prod(size) / surface(size)


def projected_area(direction, size):
    """Area of the box seen along a direction: sum of |n . d| over three faces."""
    d = np.abs(np.asarray(direction, float)) / np.linalg.norm(direction)
    return d[0] * size[1] * size[2] + d[1] * size[0] * size[2] + d[2] * size[0] * size[1]


@dataclass(frozen=True)
class View:
    """A camera: `fov` [deg] or `width` along x, row 0 on top, columns to the right."""

    origin: tuple
    target: tuple
    resolution: tuple
    fov: float = 0.0
    width: float = 0.0
    up: tuple = (0, 0, 1)

    def camera(self):
        import mcrt

        if self.fov:
            return mcrt.PerspectiveCamera(
                self.origin, self.target, self.up, self.fov, self.resolution
            )
        return mcrt.OrthographicCamera(
            self.origin, self.target, self.up, self.width, self.resolution
        )

    def frame(self):
        """Right, up and forward; half the picture's width (at distance 1, if perspective)."""
        forward = np.subtract(self.target, self.origin, dtype=float)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        half = np.tan(np.radians(self.fov / 2)) if self.fov else self.width / 2
        return right, np.cross(right, forward), forward, half

    def through(self, x, y):
        """Origins and directions (..., 3) of rays through points, in pixels from the upper left."""
        w, h = self.resolution
        right, above, forward, half = self.frame()
        x, y = np.broadcast_arrays(2 * x / w - 1, (1 - 2 * y / h) * h / w)
        offset = half * (x[..., None] * right + y[..., None] * above)
        if not self.fov:
            origin = np.asarray(self.origin, float) + offset
            return origin, np.broadcast_to(forward, origin.shape)
        direction = forward + offset
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        return np.broadcast_to(np.asarray(self.origin, float), direction.shape), direction

    def project(self, point):
        """Where a point is seen, in pixels from the upper left."""
        (w, h), to = self.resolution, np.subtract(point, self.origin)
        right, above, forward, half = self.frame()
        scale = half * (to @ forward if self.fov else 1)
        return np.array([(to @ right / scale + 1) * w / 2, (h - to @ above / scale * w) / 2])

    def rays(self, sub=1):
        """Origins, directions (h, w, sub^2, 3) at Gauss nodes of each pixel, and their weights."""
        w, h = self.resolution
        node, weight = np.polynomial.legendre.leggauss(sub)
        x = (np.arange(w)[:, None] + (node + 1) / 2)[None, :, None, :]
        y = (np.arange(h)[:, None] + (node + 1) / 2)[:, None, :, None]
        x, y = (v.reshape(h, w, sub * sub) for v in np.broadcast_arrays(x, y))
        return *self.through(x, y), np.outer(weight, weight).ravel() / 4


# ------------------------------------------------------------------------------------ optical depth


def density_at(density, spacing, points, linear):
    """Density at world points: constant in a voxel, or trilinear between centres, clamped."""
    u = np.asarray(points, float)[..., ::-1] / np.asarray(spacing, float)
    top = np.array(density.shape) - 1
    if not linear:
        index = np.clip(np.floor(u).astype(int), 0, top)
        return density[tuple(np.moveaxis(index, -1, 0))]
    u = np.clip(u - 0.5, 0, top)
    low = np.minimum(np.floor(u).astype(int), np.maximum(top - 1, 0))
    f = np.moveaxis(u - low, -1, 0)
    weights = [(1 - one, one) for one in f]
    high = np.minimum(low + 1, top)
    places = [*zip(np.moveaxis(low, -1, 0), np.moveaxis(high, -1, 0), strict=True)]
    total = 0.0
    for i, j, k in np.ndindex(2, 2, 2):
        weight = weights[0][i] * weights[1][j] * weights[2][k]
        total = total + weight * density[places[0][i], places[1][j], places[2][k]]
    return total


def optical_depth(density, spacing, start, end, linear=False):
    """Integral of the density along segments inside the box, exact: the segments are cut at every
    voxel plane (or centre plane), and between cuts the density is a constant (or a cubic: two Gauss
    nodes)."""
    start, end = (np.asarray(p, float) for p in np.broadcast_arrays(start, end))
    step = end - start
    cuts = [np.zeros((*start.shape[:-1], 1)), np.ones((*start.shape[:-1], 1))]
    for axis in range(3):
        n, h = density.shape[2 - axis], np.broadcast_to(spacing, 3)[2 - axis]
        planes = (np.arange(n) + 0.5) * h if linear else np.arange(1, n) * h
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (planes - start[..., axis, None]) / step[..., axis, None]
        cuts.append(np.clip(np.nan_to_num(t, posinf=0, neginf=0), 0, 1))
    cuts = np.sort(np.concatenate(cuts, -1), -1)
    length = np.diff(cuts) * np.linalg.norm(step, axis=-1)[..., None]
    total = 0.0
    for node in (-1 / np.sqrt(3), 1 / np.sqrt(3)) if linear else (0.0,):
        t = cuts[..., :-1] + np.diff(cuts) * (node + 1) / 2
        sigma = density_at(
            density,
            np.broadcast_to(spacing, 3),
            start[..., None, :] + t[..., None] * step[..., None, :],
            linear,
        )
        total = total + (sigma * length).sum(-1)
    return total / (2 if linear else 1)


# --------------------------------------------------------------- single scattering, homogeneous box


@dataclass(frozen=True)
class Point:
    position: tuple
    intensity: float = 1.0


@dataclass(frozen=True)
class Directional:
    direction: tuple
    irradiance: float = 1.0


def unscattered(light, points, size, sigma):
    """Directions of travel at points of a homogeneous box, and the unscattered fluence [W/m^2]."""
    if isinstance(light, Point):
        travel = points - np.asarray(light.position, float)
        distance = np.linalg.norm(travel, axis=-1)
        travel = travel / distance[..., None]
        near, _ = box_interval(
            np.broadcast_to(np.asarray(light.position, float), points.shape), travel, size
        )
        return travel, light.intensity / distance**2 * np.exp(
            -sigma * np.maximum(distance - near, 0)
        )
    travel = np.broadcast_to(
        np.asarray(light.direction, float) / np.linalg.norm(light.direction), points.shape
    )
    _, far = box_interval(points, -travel, size)
    return travel, light.irradiance * np.exp(-sigma * np.maximum(far, 0))


def single_scattering(origin, direction, size, sigma, albedo, phase, light, segments=32, order=6):
    """Radiance of light scattered once towards the rays' origins:

    L = albedo sigma int P(cos) Phi_0(x(t)) exp(-sigma (t - near)) dt over the ray's path in the
    box; for a point light in the angle at the light, which takes the 1/r^2 out (equi-angular; Kulla
    & Fajardo 2012).
    """
    near, far = box_interval(origin, direction, size)
    hit = far > near
    far = np.where(hit, far, near)
    node, weight = np.polynomial.legendre.leggauss(order)
    u = ((np.arange(segments)[:, None] + (node + 1) / 2) / segments).ravel()
    du = np.tile(weight / 2 / segments, segments)
    if isinstance(light, Point):
        closest = ((np.asarray(light.position, float) - origin) * direction).sum(-1)
        apart = np.linalg.norm(origin + closest[..., None] * direction - light.position, axis=-1)
        low, high = np.arctan2(near - closest, apart), np.arctan2(far - closest, apart)
        angle = low[..., None] + (high - low)[..., None] * u
        t = closest[..., None] + apart[..., None] * np.tan(angle)
        dt = (high - low)[..., None] * du * apart[..., None] / np.cos(angle) ** 2
    else:
        t = near[..., None] + (far - near)[..., None] * u
        dt = (far - near)[..., None] * du
    points = origin[..., None, :] + t[..., None] * direction[..., None, :]
    travel, fluence = unscattered(light, points, size, sigma)
    cosine = -(travel * direction[..., None, :]).sum(-1)
    total = (phase(cosine) * fluence * np.exp(-sigma * (t - near[..., None])) * dt).sum(-1)
    return np.where(hit, albedo * sigma * total, 0.0)


def single_image(view, size, sigma, albedo, phase, light, sub=3, **quadrature):
    """Image (h, w) of order 1: pixel means."""
    origin, direction, weight = view.rays(sub)
    return (
        single_scattering(origin, direction, size, sigma, albedo, phase, light, **quadrature)
        * weight
    ).sum(-1)


def transmittance_image(view, density, spacing, linear=False, sub=3):
    """Image (h, w) of the pixel means of exp(-tau) through the whole box."""
    origin, direction, weight = view.rays(sub)
    size = np.multiply(density.shape, spacing)[::-1]
    near, far = box_interval(origin, direction, size)
    far = np.maximum(near, far)
    tau = optical_depth(
        density,
        spacing,
        origin + near[..., None] * direction,
        origin + far[..., None] * direction,
        linear,
    )
    return (np.exp(-np.where(far > near, tau, 0)) * weight).sum(-1)


# ------------------------------------------------------------------------ fluence of order 0, means


def voxel_nodes(shape, spacing, order):
    """Gauss nodes of every voxel (nz, ny, nx, order^3, 3), world points, and their weights."""
    node, weight = np.polynomial.legendre.leggauss(order)
    axes = [
        (np.arange(n)[:, None] + (node + 1) / 2) * h
        for n, h in zip(shape, np.broadcast_to(spacing, 3), strict=True)
    ]
    nz, ny, nx = shape
    z = axes[0].reshape(nz, 1, 1, order, 1, 1)
    y = axes[1].reshape(1, ny, 1, 1, order, 1)
    x = axes[2].reshape(1, 1, nx, 1, 1, order)
    points = np.stack(np.broadcast_arrays(x, y, z), -1).reshape(nz, ny, nx, order**3, 3)
    return points, (weight[:, None, None] * weight[:, None] * weight).ravel() / 8


def fluence_of_order_0(light, density, spacing, linear=False, order=4):
    """Voxel means of the unscattered fluence, the light outside or not too close."""
    points, weight = voxel_nodes(density.shape, spacing, order)
    size = np.multiply(density.shape, np.broadcast_to(spacing, 3))[::-1]
    if isinstance(light, Point):
        step = np.asarray(light.position, float) - points
    else:
        step = np.broadcast_to(-np.asarray(light.direction, float), points.shape)
    distance = np.linalg.norm(step, axis=-1)
    back = step / distance[..., None]
    _, far = box_interval(points, back, size)
    if isinstance(light, Point):
        far = np.minimum(far, distance)
        free = light.intensity / distance**2
    else:
        free = light.irradiance
    tau = optical_depth(density, spacing, points, points + far[..., None] * back, linear)
    return (free * np.exp(-tau) * weight).sum(-1)


def column(density, spacing, start, direction, length, linear):
    """Optical depth of pieces of rays within a voxel, or between planes of centres, exact."""
    total = 0.0
    for node in (-1 / np.sqrt(3), 1 / np.sqrt(3)) if linear else (0.0,):
        points = start + (length * (node + 1) / 2)[..., None] * direction
        total = total + density_at(density, spacing, points, linear)
    return length * total / (2 if linear else 1)


def order_0_by_rays(light, density, spacing, linear=False, factors=(1.0,), rays=40, seed=0):
    """Voxel means (2, factors, nz, ny, nx) of the unscattered fluence and of the power density that
    collides of it, the density times each of the factors; unbiased, with noise of their own.

    By rays to a point drawn in each cell of a grid, so many each way, on every face through which
    light leaves the box: a ray loses exp(-tau) where it enters a voxel less that where it leaves.
    Where the density is linear its fluence is that at a point drawn on the way through the voxel.
    """
    rng = np.random.default_rng(seed)
    spacing = np.broadcast_to(np.asarray(spacing, float), 3)
    shape, h = density.shape[::-1], spacing[::-1]
    size = np.multiply(shape, h)
    total = np.zeros((2, len(factors), density.size))
    low = np.arange(rays) / rays
    for axis, side in itertools.product(range(3), (0.0, 1.0)):
        sides = [np.array([side]) if a == axis else low for a in range(3)]
        end = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3)
        end[:, np.arange(3) != axis] += rng.random((rays**2, 2)) / rays
        end *= size
        if isinstance(light, Point):
            travel = end - light.position
            distance = np.linalg.norm(travel, axis=-1)
            with np.errstate(divide="ignore", invalid="ignore"):
                free = light.intensity * travel[:, axis] / distance**3
                travel /= distance[:, None]
        else:
            travel = np.tile(light.direction / np.linalg.norm(light.direction), (len(end), 1))
            distance, free = np.inf, light.irradiance * travel[:, axis]
        free = free * (2 * side - 1)
        if not np.any(free > 0):
            continue
        far = np.minimum(box_interval(end, -travel, size)[1], distance)
        power = free * np.prod(size) / size[axis] / rays**2
        start, step = end - far[:, None] * travel, far[:, None] * travel
        cuts = [np.zeros((len(end), 1)), np.ones((len(end), 1))]
        for a in range(3):
            planes = np.arange(1, 2 * shape[a]) / 2 if linear else np.arange(1.0, shape[a])
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (planes * h[a] - start[:, a, None]) / step[:, a, None]
            cuts.append(np.clip(np.nan_to_num(t, posinf=0, neginf=0), 0, 1))
        cuts = np.sort(np.concatenate(cuts, -1), -1)
        first, length = cuts[:, :-1], np.diff(cuts) * far[:, None]
        u, v = start[:, None] + first[..., None] * step[:, None], travel[:, None]
        tau = column(density, spacing, u, v, length, linear)
        before = np.cumsum(tau, -1) - tau
        part = length * rng.random(tau.shape)
        drawn = column(density, spacing, u, v, part, linear) if linear else 0.0
        cell = ((u + length[..., None] / 2 * v) / h).astype(int)
        cell = np.ravel_multi_index(np.moveaxis(cell[..., ::-1], -1, 0), density.shape, mode="clip")
        for i, factor in enumerate(factors):
            reaches = power[:, None] * np.exp(-factor * (before + drawn))
            lost = power[:, None] * np.exp(-factor * before) * -np.expm1(-factor * tau)
            thin = tau == 0
            mean = 1.0 if linear else -np.expm1(-factor * tau) / (factor * tau + thin) + thin
            for k, part in enumerate((reaches * mean * length, lost)):
                total[k, i] += np.bincount(cell.ravel(), part.ravel(), density.size)
    return total.reshape(2, -1, *density.shape) / np.prod(h)


def fluence_of_inner_point(position, intensity, shape, spacing, sigma, order=24):
    """Voxel means of I exp(-sigma r) / r^2, the light anywhere inside, also in the voxel itself:
    Gauss's theorem,

    as exp(-sigma r) / r^2 = div [ (1 - exp(-sigma r)) / sigma r_hat / r^2 ]: a sum over the voxel's
    six faces.
    """
    spacing = np.broadcast_to(np.asarray(spacing, float), 3)
    hz, hy, hx = spacing
    node, weight = np.polynomial.legendre.leggauss(order)
    k, j, i = np.indices(shape)
    low = np.stack([i * hx, j * hy, k * hz], -1) - np.asarray(position, float)
    size = np.array([hx, hy, hz])
    total = np.zeros(shape)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        pu = low[..., u, None, None] + size[u] * (node[:, None] + 1) / 2
        pv = low[..., v, None, None] + size[v] * (node[None, :] + 1) / 2
        for sign, side in ((-1, low[..., axis]), (1, low[..., axis] + size[axis])):
            height = side[..., None, None]
            r = np.sqrt(pu**2 + pv**2 + height**2)
            flux = -np.expm1(-sigma * r) / sigma if sigma else r
            integrand = flux * sign * height / r**3
            total += np.einsum("kjiuv,u,v->kji", integrand, weight, weight) * size[u] * size[v] / 4
    return intensity * total / np.prod(spacing)


def ray_fluence(density, spacing, start, direction, response=None, linear=False, nodes=16):
    """Fluence (nz, ny, nx) per watt of a straight beam: integral of response(tau(t)) dt in each
    voxel / its volume.

    `response(tau)` is exp(-tau) (unscattered light) or, where all scattering is forward, the
    probability of at most n collisions, `scipy.stats.poisson.cdf(n, tau)`.
    """
    response = response or (lambda tau: np.exp(-tau))
    spacing = np.broadcast_to(np.asarray(spacing, float), 3)
    size = np.multiply(density.shape, spacing)[::-1]
    start, direction = (
        np.asarray(start, float),
        np.asarray(direction, float) / np.linalg.norm(direction),
    )
    near, far = box_interval(start, direction, size)
    cuts = [near, far]
    for axis in range(3):
        if direction[axis]:
            planes = np.arange(density.shape[2 - axis] + 1) * spacing[2 - axis]
            cuts += list((planes - start[axis]) / direction[axis])
    cuts = np.unique(np.clip(cuts, near, far))
    entry = start + near * direction
    x, w = np.polynomial.legendre.leggauss(nodes)
    fluence = np.zeros(density.shape)
    for a, b in itertools.pairwise(cuts):
        if b - a > 1e-12 * (far - near):
            t = a + (b - a) * (x + 1) / 2
            tau = optical_depth(density, spacing, entry, start + t[:, None] * direction, linear)
            voxel = tuple(
                np.minimum(
                    ((start + (a + b) / 2 * direction)[::-1] / spacing).astype(int),
                    np.array(density.shape) - 1,
                )
            )
            fluence[voxel] += (response(tau) * w).sum() * (b - a) / 2
    return fluence / np.prod(spacing)
