// Point lights close to a view ray, where 1 / distance^2 is no polynomial.

// A light nearer than this many steps is integrated by angle.
const CLOSE = 4.0;
// Nodes and weights of four Gauss points.
const NODES = vec4(0.069431846, 0.3300095, 0.6699905, 0.9305682);
const WEIGHTS = vec4(0.17392743, 0.32607257, 0.32607257, 0.17392743);
const TURN = 6.2831855;

// The density along a step, linear through its two Gauss points; u runs from 0 to 1.
struct Profile {
    s1: f32,
    slope: f32,
    step: f32,
}

// The density at u.
fn profile_density(profile: Profile, u: f32) -> f32 {
    return max(profile.s1 + profile.slope * (u - U1), 0.0);
}

// The integral of the density over the first u of the step.
fn profile_column(profile: Profile, u: f32) -> f32 {
    return (profile.s1 * u + profile.slope * (0.5 * u * u - U1 * u)) * profile.step;
}

// The parameter of the point of a step nearest to a light, its distance, and whether the light is close.
struct Near {
    foot: f32,
    off: f32,
    is_close: bool,
}

// For a step that starts at p.
fn close_light(light: Light, p: vec3<f32>, direction: vec3<f32>, step: f32) -> Near {
    if light.is_point == 0u {
        return Near(0.0, 0.0, false);
    }
    let to = (light.place - p) * scene.h;
    let foot = to.x * direction.x + to.y * direction.y + to.z * direction.z;
    let r = to - foot * direction;
    let off = sqrt(r.x * r.x + r.y * r.y + r.z * r.z);
    let middle = 0.5 * step - foot;
    return Near(foot, off, off * off + middle * middle < (CLOSE * step) * (CLOSE * step));
}

// A step that passes close to a point light: nodes equally spaced in the angle seen from the light, in which 1/d^2 is
// constant (Kulla and Fajardo, Importance sampling techniques for path tracing in participating media, 2012).
fn close(light: Light, near: Near, ray: Ray, start: f32, profile: Profile, before: f32) -> Spectrum {
    let foot = near.foot;
    let off = max(max(near.off, ray.least_off), 1e-6 * profile.step);
    let low = arc_tangent(-foot / off);
    let high = arc_tangent((profile.step - foot) / off);
    let extinction = spectrum(scene.extinction);
    var sum = Spectrum(0.0);
    for (var i = 0u; i < 8u; i++) {
        let angle = low + (high - low) * (f32(i / 4u) + NODES[i % 4u]) * 0.5;
        let turn = sin_cos_turn(angle / TURN);
        let t = clamp(foot + off * (turn.x / turn.y), 0.0, profile.step);
        let d2 = off * off + (t - foot) * (t - foot);
        let length = WEIGHTS[i % 4u] * 0.5 * (high - low) * d2 / off;
        let p = along(ray.p, ray.v, start + t);
        let u = t / profile.step;
        let factor = factor(p, profile_density(profile, u) * length, before + profile_column(profile, u));
        let here = incident(light, p);
        let column = light_ray(p, here);
        let scattered = toward_eye(here.direction, ray.direction) / d2;
        sum += factor * spectrum(light.value) * scattered * expos(-extinction * column);
    }
    return sum;
}

// The angle of a tangent (Cephes, atanf).
fn arc_tangent(x: f32) -> f32 {
    let size = abs(x);
    var base = 0.0;
    var r = size;
    if size > 2.4142135 {
        base = FRAC_PI_2;
        r = -1.0 / size;
    } else if size > 0.41421357 {
        base = 0.5 * FRAC_PI_2;
        r = (size - 1.0) / (size + 1.0);
    }
    let z = r * r;
    var y = 8.0537446e-2;
    y = y * z - 1.3877686e-1;
    y = y * z + 1.9977711e-1;
    y = y * z - 3.3332949e-1;
    let angle = base + (y * z * r + r);
    return select(angle, -angle, x < 0.0);
}
