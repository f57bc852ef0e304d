// Directions: turning one by a scattering angle.

// Two unit vectors, normal to each other.
struct Pair {
    u: vec3<f32>,
    v: vec3<f32>,
}

// An orthonormal pair to the unit vector w (Duff et al., Building an orthonormal basis, revisited, JCGT 6(1), 2017).
fn orthonormal(w: vec3<f32>) -> Pair {
    let sign = bitcast<f32>(0x3f800000u | (bitcast<u32>(w.z) & 0x80000000u));
    let a = -(1.0 / (sign + w.z));
    let b = w.x * w.y * a;
    return Pair(vec3(1.0 + sign * w.x * w.x * a, sign * b, -(sign * w.x)), vec3(b, sign + w.y * w.y * a, -w.y));
}

// The unit vector at the polar angle of (cos_theta, sin_theta) to w and the azimuth 2 pi xi, renormalised to first
// order so that long walks keep their length.
fn rotate(w: vec3<f32>, cos_theta: f32, sin_theta: f32, xi: f32) -> vec3<f32> {
    let pair = orthonormal(w);
    let turn = sin_cos_turn(xi);
    let x = sin_theta * turn.y;
    let y = sin_theta * turn.x;
    let d = x * pair.u + y * pair.v + cos_theta * w;
    let scale = 1.5 - 0.5 * (d.x * d.x + d.y * d.y + d.z * d.z);
    return d * scale;
}

// A direction uniform over the sphere, from its cosine to z, 1 - 2 xi, and its azimuth, 2 pi turn.
fn sphere(xi: f32, turn: f32) -> vec3<f32> {
    let z = 1.0 - 2.0 * xi;
    let r = sqrt(max(4.0 * xi * (1.0 - xi), 0.0));
    let phi = sin_cos_turn(turn);
    return vec3(r * phi.y, r * phi.x, z);
}
