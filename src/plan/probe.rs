//! What view rays meet, measured on the scene before anything is decided: how opaque it is, how dense the voxels are that are
//! seen, and what interpolating the light grid would cost in accuracy.

use crate::scene::field::{Field, Occupancy, V3};
use crate::scene::{Light, Scene, ViewRay};

/// View rays probed, and points on each.
const RAYS: usize = 96;
const POINTS: usize = 12;
/// View rays looked at to find that many that meet something.
const TRIES: usize = 2000;

/// The root mean square error that an order 1 image would have if the optical depth towards the light were interpolated
/// in the light grid, over the image's own. Points are drawn along the camera's rays as their light reaches the eye.
pub fn interpolation_error(scene: &Scene, light: &Light) -> f64 {
    error_between(scene, light, 0.5, 1.0, false)
}

/// The same with nodes at all faces, edges, corners and centres of voxels, lowered by a twelfth of their second differences.
pub fn fine_error(scene: &Scene, light: &Light) -> f64 {
    error_between(scene, light, 0.0, 0.5, true)
}

/// The same with nodes every `step` voxels from `first` on.
fn error_between(scene: &Scene, light: &Light, first: f32, step: f32, lowered: bool) -> f64 {
    let volume = &scene.medium.volume;
    let occupancy = Occupancy::new(volume);
    let field = Field::density(volume).skipping(occupancy.as_ref());
    let (n, h) = (volume.n(), volume.spacing());
    let extinction = scene.medium.extinction.max();
    let transmittance = |column: f64| (-extinction * column).exp();
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
    // Nodes beyond a face carry on the line through the centre before it and the face.
    let node = |p: V3| {
        let face: V3 = std::array::from_fn(|a| p[a].clamp(0.0, n[a] as f32));
        if face == p { column(p) } else { 2.0 * column(face) - column(std::array::from_fn(|a| 2.0 * face[a] - p[a])) }
    };
    let interpolated = |p: V3| {
        let low: V3 = std::array::from_fn(|a| ((p[a] - first) / step).floor() * step + first);
        // Nodes are known by their steps from the one before the point, from -1 to 2 along each axis.
        let mut found = [None::<f64>; 64];
        let mut column = |at: [i32; 3]| {
            let kept = &mut found[at.iter().rev().fold(0, |place, &c| 4 * place + (c + 1) as usize)];
            *kept.get_or_insert_with(|| node(std::array::from_fn(|a| low[a] + step * at[a] as f32)))
        };
        let sum = (0..8).fold(0.0, |sum, corner| {
            let side: [i32; 3] = std::array::from_fn(|a| corner >> a & 1);
            let weight: f32 = (0..3)
                .map(|a| if side[a] == 1 { (p[a] - low[a]) / step } else { 1.0 - (p[a] - low[a]) / step })
                .product();
            let mut here = column(side);
            for axis in (0..3).filter(|_| lowered) {
                let beside = [-1, 1].map(|way| std::array::from_fn(|a| side[a] + if a == axis { way } else { 0 }));
                let inside = |at: &[i32; 3]| (0.0..=n[axis] as f32).contains(&(low[axis] + step * at[axis] as f32));
                if beside.iter().all(inside) {
                    here -= (column(beside[0]) - 2.0 * column(side) + column(beside[1])) / 12.0;
                }
            }
            sum + f64::from(weight) * here
        });
        sum.max(0.0)
    };
    let (mut error, mut square) = (0.0, 0.0);
    for (start, velocity, length, whole) in seeing(scene, &field).take(RAYS) {
        let seen = 1.0 - transmittance(whole);
        let (mut difference, mut sum) = (0.0, 0.0);
        for k in 0..POINTS {
            // The column after which the part (k + 1/2) / POINTS of what is seen lies behind.
            let target = -(1.0 - seen * (k as f64 + 0.5) / POINTS as f64).ln() / extinction;
            let at = depth_at(&field, start, velocity, length, target as f32);
            let p: V3 = std::array::from_fn(|a| (start[a] + velocity[a] * at).clamp(0.0, n[a] as f32));
            let exact = transmittance(column(p));
            difference += seen * (transmittance(interpolated(p)) - exact);
            sum += seen * exact;
        }
        error += difference * difference;
        square += sum * sum;
    }
    if square > 0.0 { (error / square).sqrt() } else { 0.0 }
}

/// The mean opacity along view rays that meet anything, the least channel's; 0 if none does.
pub fn opacity(scene: &Scene) -> f64 {
    let occupancy = Occupancy::new(&scene.medium.volume);
    let field = Field::density(&scene.medium.volume).skipping(occupancy.as_ref());
    let extinction = scene.medium.extinction.rgb.into_iter().fold(f64::INFINITY, f64::min);
    let seen: Vec<f64> =
        seeing(scene, &field).take(RAYS).map(|(.., column)| -(-extinction * column).exp_m1()).collect();
    if seen.is_empty() { 0.0 } else { seen.iter().sum::<f64>() / seen.len() as f64 }
}

/// The mean optical depth along the view of the voxels that are seen, the densest channel's: over points drawn as their
/// light reaches the eye. 0 if nothing is.
pub fn seen_depth(scene: &Scene) -> f64 {
    let volume = &scene.medium.volume;
    let occupancy = Occupancy::new(volume);
    let field = Field::density(volume).skipping(occupancy.as_ref());
    let n = volume.n();
    let extinction = scene.medium.extinction.max();
    let (mut sum, mut weight) = (0.0, 0.0);
    for (start, velocity, length, whole) in seeing(scene, &field).take(RAYS) {
        let seen = -(-extinction * whole).exp_m1();
        let voxel = 1.0 / velocity.iter().map(|v| f64::from(v.abs())).sum::<f64>();
        for k in 0..POINTS {
            let target = -(1.0 - seen * (k as f64 + 0.5) / POINTS as f64).ln() / extinction;
            let at = depth_at(&field, start, velocity, length, target as f32);
            let p: V3 = std::array::from_fn(|a| (start[a] + velocity[a] * at).clamp(0.0, n[a] as f32));
            sum += seen * extinction * f64::from(field.at(p)) * voxel;
            weight += seen;
        }
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// View rays spread over the image, of those that meet any density: entry, velocity, length, and column density.
fn seeing<'a>(scene: &'a Scene, field: &'a Field) -> impl Iterator<Item = (V3, V3, f32, f64)> + 'a {
    let [width, height] = scene.camera.resolution.map(|r| r as f64);
    (0..TRIES).filter_map(move |i| {
        let (x, y) = (radical_inverse(i + 1, 2) * width, radical_inverse(i + 1, 3) * height);
        let ray = ViewRay::new(scene, &scene.camera, x, y)?;
        let column = f64::from(field.column(ray.p, ray.v, ray.length));
        (column > 0.0).then_some((ray.p, ray.v, ray.length, column))
    })
}

/// The parameter at which the column density along a line reaches `target`, linear within a cell.
fn depth_at(field: &Field, p: V3, v: V3, end: f32, target: f32) -> f32 {
    let (mut sum, mut at) = (0.0f32, end);
    field.visit(p, v, end, |_, t0, t1| {
        let middle = std::array::from_fn(|a| p[a] + v[a] * 0.5 * (t0 + t1));
        let piece = field.at(middle) * (t1 - t0);
        if sum + piece >= target && piece > 0.0 {
            at = t0 + (t1 - t0) * ((target - sum) / piece).max(0.0);
            return false;
        }
        sum += piece;
        true
    });
    at
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
        let camera = Camera::perspective([30.0, -30.0, 20.0], [6.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
        interpolation_error(&Scene::new(medium, vec![light.clone()], camera), &light)
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
