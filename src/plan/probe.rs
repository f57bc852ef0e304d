//! What interpolating the light grid would cost in accuracy, measured on the scene before anything is decided.

use crate::scene::field::{Field, Occupancy, V3};
use crate::scene::{Light, Scene};

/// Points probed.
const PROBES: usize = 400;
/// Points looked at to find that many with something to scatter.
const TRIES: usize = 8000;

/// The root mean square error of the transmittance towards a light when its optical depth is interpolated between voxel
/// corners, over that of the transmittance itself, at points that scatter.
pub fn interpolation_error(scene: &Scene, light: &Light) -> f64 {
    let volume = &scene.medium.volume;
    let occupancy = Occupancy::new(volume);
    let field = Field::density(volume).skipping(occupancy.as_ref());
    let (n, h) = (volume.n(), volume.spacing());
    let column = |p: V3| {
        let (to, end) = match light {
            Light::Point { position, .. } => {
                let local = volume.local(*position);
                let r: [f64; 3] = std::array::from_fn(|a| local[a] - f64::from(p[a]) * h[a]);
                let d = r.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-30);
                (r.map(|c| c / d), d)
            }
            Light::Directional { direction, .. } => (direction.map(|c| -c), f64::INFINITY),
            Light::Pencil { .. } | Light::Environment { .. } => return 0.0,
        };
        let v: V3 = std::array::from_fn(|a| (to[a] / h[a]) as f32);
        f64::from(field.column(p, v, end as f32))
    };
    let extinction = scene.medium.extinction.max();
    let (mut error, mut square, mut probes) = (0.0, 0.0, 0);
    for i in 0..TRIES {
        let x: [f64; 3] = [(i, 2), (i, 3), (i, 5)].map(|(i, base)| radical_inverse(i + 1, base));
        let p: V3 = std::array::from_fn(|a| (x[a] * n[a] as f64) as f32);
        if field.at(p) <= 0.0 {
            continue;
        }
        let low = p.map(f32::floor);
        let mut interpolated = 0.0;
        for corner in 0..8 {
            let side: V3 = std::array::from_fn(|a| (corner >> a & 1) as f32);
            let weight: f32 = (0..3).map(|a| (1.0 - side[a]) + (2.0 * side[a] - 1.0) * (p[a] - low[a])).product();
            interpolated += f64::from(weight) * column(std::array::from_fn(|a| low[a] + side[a]));
        }
        let exact = (-extinction * column(p)).exp();
        error += ((-extinction * interpolated).exp() - exact).powi(2);
        square += exact * exact;
        probes += 1;
        if probes == PROBES {
            break;
        }
    }
    if square > 0.0 { (error / square).sqrt() } else { 0.0 }
}

/// The van der Corput sequence.
fn radical_inverse(mut i: usize, base: usize) -> f64 {
    let (mut value, mut scale) = (0.0, 1.0);
    while i > 0 {
        scale /= base as f64;
        value += scale * (i % base) as f64;
        i /= base;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Albedo, Camera, Medium, Spectrum, Volume};

    fn error(density: &[f32], extinction: f64, towards: [f64; 3]) -> f64 {
        let volume = Volume::new(density, [12; 3], [1.0; 3], [0.0; 3], true).expect("valid");
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        let phase = crate::physics::Phase::Isotropic;
        let medium = Medium::new(volume, grey(extinction), Albedo::Constant(grey(0.9)), phase).expect("valid");
        let light = Light::directional(towards, &[1.0]).expect("valid");
        let camera = Camera::perspective([0.0, -9.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 40.0, [1, 1]).expect("valid");
        interpolation_error(&Scene::new(medium, vec![light], camera), &light)
    }

    #[test]
    fn interpolation_errs_where_the_density_jumps() {
        let jumps: Vec<f32> = (0..1728).map(|i| f32::from(u8::from((i * 7919) % 5 == 0))).collect();
        let oblique = [0.3, 0.2, 1.0];
        assert!(error(&[1.0; 1728], 0.5, [0.0, 0.0, 1.0]) < 1e-5);
        assert!(error(&jumps, 2.0, oblique) > 0.02);
        assert!(error(&jumps, 0.02, oblique) < 0.1 * error(&jumps, 2.0, oblique));
    }
}
