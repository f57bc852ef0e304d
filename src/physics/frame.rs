//! Directions: turning one by a scattering angle.

use super::Real;

/// An orthonormal pair to the unit vector `w` (Duff et al., *Building an orthonormal basis, revisited*, JCGT 6(1), 2017).
#[inline(always)]
pub fn orthonormal<R: Real>(w: [R; 3]) -> ([R; 3], [R; 3]) {
    let one = R::of(1.0);
    let sign = one.copysign(w[2]);
    let a = -(one / (sign + w[2]));
    let b = w[0] * w[1] * a;
    ([one + sign * w[0] * w[0] * a, sign * b, -(sign * w[0])], [b, sign + w[1] * w[1] * a, -w[1]])
}

/// The unit vector at the polar angle of (`cos_theta`, `sin_theta`) to `w` and the azimuth 2 pi `xi`, renormalised to first
/// order so that long walks keep their length.
#[inline(always)]
pub fn rotate<R: Real>(w: [R; 3], cos_theta: R, sin_theta: R, xi: R) -> [R; 3] {
    let (u, v) = orthonormal(w);
    let (sin_phi, cos_phi) = xi.sin_cos_turn();
    let (x, y) = (sin_theta * cos_phi, sin_theta * sin_phi);
    let d: [R; 3] = std::array::from_fn(|i| x * u[i] + y * v[i] + cos_theta * w[i]);
    let scale = R::of(1.5) - R::of(0.5) * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    d.map(|c| c * scale)
}

/// A direction uniform over the sphere, from its cosine to z, 1 - 2 `xi`, and its azimuth, 2 pi `turn`.
#[inline(always)]
pub fn sphere<R: Real>(xi: R, turn: R) -> [R; 3] {
    let z = R::of(1.0) - R::of(2.0) * xi;
    let r = (R::of(4.0) * xi * (R::of(1.0) - xi)).max(R::of(0.0)).sqrt();
    let (sin_phi, cos_phi) = turn.sin_cos_turn();
    [r * cos_phi, r * sin_phi, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rotation_keeps_the_polar_angle_and_the_length(z in -1.0..1.0f64, phi in 0.0..6.3f64, mu in -1.0..1.0f64, xi in 0.0..1.0f64) {
            let s = (1.0 - z * z).sqrt();
            let w = [s * phi.cos(), s * phi.sin(), z];
            let d = rotate(w, mu, (1.0 - mu * mu).sqrt(), xi);
            let dot: f64 = (0..3).map(|i| d[i] * w[i]).sum();
            let norm: f64 = d.iter().map(|c| c * c).sum();
            prop_assert!((dot - mu).abs() < 1e-12 && (norm - 1.0).abs() < 1e-12);
            let single = rotate(w.map(|c| c as f32), mu as f32, (1.0 - mu * mu).sqrt() as f32, xi as f32);
            for i in 0..3 {
                prop_assert!((f64::from(single[i]) - d[i]).abs() < 4e-6);
            }
        }
    }

    #[test]
    fn a_million_turns_keep_the_length() {
        let mut w = [0.0f32, 0.0, 1.0];
        for i in 0..1_000_000u64 {
            let mu = ((i * 7919) % 2001) as f32 / 1000.0 - 1.0;
            w = rotate(w, mu, (1.0 - mu * mu).max(0.0).sqrt(), ((i * 104_729) % 1000) as f32 / 1000.0);
        }
        let square: f64 = w.iter().map(|&c| f64::from(c) * f64::from(c)).sum();
        assert!((square - 1.0).abs() < 1e-6, "{square}");
    }
}
