//! Where a light's photons meet the medium first: they start at that collision, in voxels drawn by what collides there.

use super::super::light::Illumination;
use crate::physics::Real;
use crate::scene::Scene;
use crate::scene::field::{Field, V3};
use rayon::prelude::*;

/// The distribution of a light's first collisions over the voxels, from which they are drawn by systematic sampling.
pub struct FirstCollisions<'a> {
    pub(in crate::backend) light: Illumination<'a>,
    pub(in crate::backend) interpolated: bool,
    /// Each voxel's share.
    pub(in crate::backend) power: Vec<f32>,
    /// Sums of the shares up to the end of each row along x.
    pub(in crate::backend) rows: Vec<f64>,
    extinction: [f32; 3],
    /// The light's value that makes the mean weight 1, by channel; 0 where it has no power.
    pub(in crate::backend) factors: [f32; 3],
    pub(in crate::backend) volume: f32,
    n: [usize; 2],
}

/// How far the search for voxels has come: it goes on from here, for photons come in the order of their voxels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cursor {
    started: bool,
    row: usize,
    i: usize,
    /// Sum of the row's shares before i.
    sum: f64,
}

impl<'a> FirstCollisions<'a> {
    /// The voxels' shares, and the power of all by channel: mean density times unscattered fluence at
    /// the centre, of the channel whose part of its own power is largest there.
    pub fn new(
        scene: &Scene<'a>,
        light: &Illumination<'a>,
        value: [f64; 3],
        interpolated: bool,
    ) -> Option<(Self, [f64; 3])> {
        let volume = &scene.medium.volume;
        let (n, density) = (volume.n(), Field::density(volume));
        let extinction = scene.medium.extinction.rgb.map(|e| e as f32);
        let cubic = volume.voxel_volume() as f32;
        // The collisions in a voxel of a light whose channels all have the largest value, by channel.
        let largest = value.iter().copied().fold(0.0, f64::max);
        let collisions = |[i, j, k]: [usize; 3]| {
            let mean = if light.occupied([i, j, k]) { density.voxel_mean([i, j, k]) } else { 0.0 };
            if mean == 0.0 {
                return [0.0; 3];
            }
            let p = [i as f32 + 0.5, j as f32 + 0.5, k as f32 + 0.5];
            let incident = light.incident(p);
            let column = light.rough_column(p, &incident);
            extinction.map(|e| mean * (e * largest as f32 * (-e * column).exp()) * incident.falloff * cubic)
        };
        let shine = value.map(|v| if v > 0.0 { 1.0 } else { 0.0 });
        let mut sums = shine;
        if scene.medium.is_chromatic() {
            let row = |row: usize| {
                let mut sums = [0.0f64; 3];
                for i in 0..n[0] {
                    let here = collisions([i, row % n[1], row / n[1]]);
                    (0..3).for_each(|c| sums[c] += shine[c] * f64::from(here[c]));
                }
                sums
            };
            let rows: Vec<[f64; 3]> = (0..n[1] * n[2]).into_par_iter().map(row).collect();
            sums = std::array::from_fn(|c| rows.iter().map(|row| row[c]).sum());
        }
        // What makes the channels' sums equal.
        let top = sums.iter().copied().fold(0.0, f64::max);
        let level = sums.map(|sum| if sum > 0.0 { (top / sum).min(f64::from(f32::MAX)) as f32 } else { 0.0 });
        let mut power = vec![0.0f32; volume.voxels()];
        let rows = power.par_chunks_mut(n[0]).enumerate().map(|(row, out)| {
            let mut sum = 0.0f64;
            for (i, share) in out.iter_mut().enumerate() {
                let here = collisions([i, row % n[1], row / n[1]]);
                *share = (0..3).map(|c| here[c] * level[c]).fold(0.0, f32::max);
                sum += f64::from(*share);
            }
            sum
        });
        let mut total = 0.0;
        let rows: Vec<f64> = rows
            .collect::<Vec<f64>>()
            .into_iter()
            .map(|s| {
                total += s;
                total
            })
            .collect();
        // With one extinction the shares are the collisions of each channel.
        let each = if scene.medium.is_chromatic() { sums } else { shine.map(|s| s * total) };
        let factors =
            each.map(|sum| if sum > 0.0 { (total / sum * largest).min(f64::from(f32::MAX)) as f32 } else { 0.0 });
        let light = light.clone();
        let first =
            FirstCollisions { light, interpolated, power, rows, extinction, factors, volume: cubic, n: [n[0], n[1]] };
        (total > 0.0).then_some((first, std::array::from_fn(|c| each[c] * (value[c] / largest))))
    }

    /// The voxel at the part `u` of all collisions, and its share; `u` must not fall from call to call of one cursor. The
    /// result does not depend on where the cursor set out.
    #[inline(always)]
    pub fn find(&self, cursor: &mut Cursor, u: f64) -> ([usize; 3], f32) {
        let target = u * self.rows[self.rows.len() - 1];
        if !cursor.started {
            let row = self.rows.partition_point(|&sum| sum <= target).min(self.rows.len() - 1);
            *cursor = Cursor { started: true, row, i: 0, sum: 0.0 };
        }
        while self.rows[cursor.row] <= target && cursor.row + 1 < self.rows.len() {
            *cursor = Cursor { started: true, row: cursor.row + 1, i: 0, sum: 0.0 };
        }
        let row = cursor.row;
        let rest = target - if row > 0 { self.rows[row - 1] } else { 0.0 };
        let [nx, ny] = self.n;
        let values = &self.power[row * nx..(row + 1) * nx];
        while cursor.i + 1 < nx && (rest >= cursor.sum + f64::from(values[cursor.i]) || values[cursor.i] == 0.0) {
            cursor.sum += f64::from(values[cursor.i]);
            cursor.i += 1;
        }
        // Rounding may run over the end of the row onto a voxel without power: back to one with.
        let mut i = cursor.i;
        while values[i] == 0.0 && i > 0 {
            i -= 1;
        }
        ([i, row % ny, row / ny], values[i])
    }

    /// The direction of the light at a point of a voxel with the given share, and the weight there by channel.
    #[inline(always)]
    pub fn arrive(&self, p: V3, share: f32) -> (V3, [f32; 3]) {
        let incident = self.light.incident(p);
        let column =
            if self.interpolated { self.light.rough_column(p, &incident) } else { self.light.column(p, &incident) };
        let scale = self.light.density(p) * incident.falloff * self.volume / share.max(1e-38);
        let weight = std::array::from_fn(|c| {
            self.extinction[c] * self.factors[c] * Real::exp(-self.extinction[c] * column) * scale
        });
        (incident.direction, weight)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Emitter;
    use super::*;
    use crate::backend::Control;
    use crate::backend::views::{illuminations, light_grids};
    use crate::physics::rng::{Draws, uniform64};
    use crate::plan::{Plan, Settings};
    use crate::scene::{Albedo, Camera, Light, Medium, Spectrum, Volume};

    #[test]
    fn first_collisions_are_drawn_in_proportion_and_weigh_one_on_average() {
        const N: [usize; 3] = [7, 6, 8];
        let words = |at: usize| Draws::new([9, 2], at as u64, 0).next4().map(uniform64);
        // So smooth that interpolated depths are right to a part in a hundred everywhere.
        let wave = |at: usize, axis: usize| (0.3 * (at % N[axis]) as f32).sin();
        let voxels: Vec<f32> = (0..N.iter().product())
            .map(|at| 0.2 + wave(at, 0) + wave(at / N[0], 1) + wave(at / (N[0] * N[1]), 2))
            .collect();
        let volume = Volume::new(&voxels, N, [1.0, 0.8, 1.2], [0.0; 3], false).expect("valid");
        let grey = |value: f64| Spectrum::new(&[value], "value").expect("valid");
        let phase = crate::physics::Phase::Isotropic;
        let medium = Medium::new(volume, grey(0.25), Albedo::Constant(grey(0.9)), phase).expect("valid");
        let camera = Camera::perspective([40.0, 0.0, 0.0], [3.0; 3], [0.0, 0.0, 1.0], 30.0, [4, 4]).expect("valid");
        let light = Light::directional([0.3, -0.4, -1.0], &[2.0]).expect("valid");
        let scene = Scene::new(medium, vec![light], camera);
        let plan = Plan::new(&scene, &Settings { photons: Some(1000), ..Settings::default() }).expect("a plan");
        let columns = light_grids(&plan, None, &Control::new(None));
        let views = illuminations(&scene, None, plan.lights.iter().map(|l| l.column), &columns);
        let emitter = Emitter::new(&scene, &scene.lights[0], &plan.lights[0], views[0].as_ref()).expect("it shines");
        let first = emitter.first_collisions().expect("voxels are thin");
        let (count, mut cursor) = (400_000, Cursor::default());
        let (mut drawn, mut weights) = (vec![0.0; voxels.len()], vec![0.0; voxels.len()]);
        for photon in 0..count {
            let (voxel, share) = first.find(&mut cursor, (f64::from(photon) + 0.5) / f64::from(count));
            let xi = words(photon as usize);
            let p: V3 = std::array::from_fn(|a| voxel[a] as f32 + xi[a] as f32);
            let at = (voxel[2] * N[1] + voxel[1]) * N[0] + voxel[0];
            drawn[at] += 1.0;
            weights[at] += f64::from(first.arrive(p, share).1[0]);
        }
        let total = first.power.iter().map(|&power| f64::from(power)).sum::<f64>();
        // Truth: collisions where the light arrives, by the midpoints of 10^3 parts of each voxel.
        let view = views[0].as_ref().expect("it has a direction");
        let collisions = |at: usize| {
            let corner = [at % N[0], at / N[0] % N[1], at / (N[0] * N[1])];
            let parts = (0..1000).map(|part| {
                let p = [part % 10, part / 10 % 10, part / 100].map(|c| (c as f32 + 0.5) / 10.0);
                let p: V3 = std::array::from_fn(|a| corner[a] as f32 + p[a]);
                (-0.25 * f64::from(view.ray(p, &view.incident(p)))).exp()
            });
            2.0 * 0.25 * f64::from(voxels[at]) * parts.sum::<f64>() / 1000.0 * volume.voxel_volume()
        };
        let truth: Vec<f64> = (0..voxels.len()).map(collisions).collect();
        for at in 0..voxels.len() {
            let expected = f64::from(first.power[at]) / total * f64::from(count);
            assert!((drawn[at] - expected).abs() < 1.5, "{at}: {} drawn of {expected}", drawn[at]);
            // Its photons' weights vary by a tenth or two.
            let found = weights[at] / f64::from(count) * emitter.powers[0];
            let error = 0.2 / f64::max(drawn[at], 1.0).sqrt();
            assert!(
                (found - truth[at]).abs() <= (5.0 * error + 0.02) * truth[at],
                "{at}: {found} and not {}",
                truth[at]
            );
        }
        let (found, truth) =
            (weights.iter().sum::<f64>() / f64::from(count), truth.iter().sum::<f64>() / emitter.powers[0]);
        assert!((found / truth - 1.0).abs() < 2e-3, "mean weight {found} and not {truth}");
    }
}
