//! Unscattered light of points, of parallel light and of beams: what it leaves in the voxels and in the energy balance, by
//! light rays that cross the whole box and whose light is followed exactly through each voxel.
//!
//! Rays are dealt out in [`REPLICATES`] lattices of random shift. The mean over these is the value, their scatter its
//! standard error (Student's t with [`REPLICATES`] - 1 degrees of freedom).

mod aim;
mod tally;
mod vacuum;
mod voxels;
mod walk;

use crate::physics::rng::{split, uniform64, words};
use crate::plan::REPLICATES;
use crate::scene::field::V3;
use crate::scene::{Albedo, Scene};
use rayon::prelude::*;
use walk::DARK;

pub use aim::Aim;
pub use voxels::{Means, Wanted, means};
pub use walk::{Fate, Matter, Way};

/// The purpose of the random numbers that shift them.
const SHIFT: u32 = 10;
/// Voxels that the rays of an energy balance may cross, all together: where photons sample all but what passes unscattered,
/// and where nothing else says what collides.
const CROSSED: [f64; 2] = [3e4, 2e5];

/// Where the light that the box receives of a light of value 1 goes, by channel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Balance {
    /// What leaves the box unscattered.
    pub through: [f64; 3],
    /// Its standard error.
    pub error: [f64; 3],
    /// What its first collision absorbs.
    pub absorbed: [f64; 3],
    /// Its standard error.
    pub absorbed_error: [f64; 3],
    /// What its first collision scatters.
    pub scattered: [f64; 3],
}

/// The shift of a replicate's lattice, or of one more: one for the energy balance, one for the voxels.
fn shift(seed: u64, light: usize, replicate: u64, voxels: bool) -> [f64; 2] {
    let words = words(split(seed), split(light as u64 * (REPLICATES + 1) + replicate), u32::from(voxels), SHIFT);
    [uniform64(words[0]), uniform64(words[1])]
}

/// Where the light that the box receives of a light of value 1 goes, `quiet` if nothing else says what collides of it.
pub fn balance(scene: &Scene, (light, aim): (usize, &Aim), seed: u64, quiet: bool) -> Balance {
    if scene.medium.is_chromatic() {
        balance_of::<3>(scene, (light, aim), seed, quiet)
    } else {
        balance_of::<1>(scene, (light, aim), seed, quiet)
    }
}

fn balance_of<const K: usize>(scene: &Scene, (light, aim): (usize, &Aim), seed: u64, quiet: bool) -> Balance {
    let matter = Matter::<K>::new(scene);
    let across: usize = scene.medium.volume.n().iter().sum();
    let replicates: Vec<Fate<K>> = (0..REPLICATES)
        .into_par_iter()
        .map(|replicate| {
            let rays = CROSSED[usize::from(quiet)] / (REPLICATES as f64 * 0.5 * across as f64);
            let mut sum = Fate::ZERO;
            aim.over_faces(rays.clamp(300.0, 30_000.0), shift(seed, light, replicate, false), |way, flux| {
                let fate = if quiet { matter.fate(way) } else { matter.passage(way) };
                sum.add(&fate, flux);
            });
            sum
        })
        .collect();
    let k = REPLICATES as f64;
    let mut mean = Fate::<K>::ZERO;
    replicates.iter().for_each(|fate| mean.add(fate, 1.0 / k));
    let error = |of: fn(&Fate<K>) -> [f64; K]| {
        let square = |c: usize| replicates.iter().map(|fate| (of(fate)[c] - of(&mean)[c]).powi(2)).sum::<f64>();
        std::array::from_fn(|c| (square(c) / (k * (k - 1.0))).sqrt())
    };
    Balance::of(scene, &mean, [error(|fate| fate.through), error(|fate| fate.absorbed)])
}

impl Balance {
    /// That of a beam; `None` if it misses the box.
    pub fn of_beam(scene: &Scene, position: [f64; 3], direction: [f64; 3]) -> Option<Self> {
        let way = beam(scene, position, direction)?;
        Some(if scene.medium.is_chromatic() {
            Balance::of(scene, &Matter::<3>::new(scene).fate(&way), [[0.0; 3]; 2])
        } else {
            Balance::of(scene, &Matter::<1>::new(scene).fate(&way), [[0.0]; 2])
        })
    }

    /// By channel, from what becomes of the light by extinction.
    fn of<const K: usize>(scene: &Scene, fate: &Fate<K>, [error, absorbed]: [[f64; K]; 2]) -> Self {
        let coalbedo = coalbedo(scene);
        let by = |values: &[f64; K], c: usize| values[c % K];
        Balance {
            through: std::array::from_fn(|c| by(&fate.through, c)),
            error: std::array::from_fn(|c| by(&error, c)),
            absorbed: std::array::from_fn(|c| by(&fate.absorbed, c) * coalbedo[c]),
            absorbed_error: std::array::from_fn(|c| by(&absorbed, c) * coalbedo[c]),
            scattered: std::array::from_fn(|c| by(&fate.scattered, c) + by(&fate.absorbed, c) * (1.0 - coalbedo[c])),
        }
    }
}

/// 1 - albedo where that is constant; 1 where rays find what is absorbed.
pub fn coalbedo(scene: &Scene) -> [f64; 3] {
    match scene.medium.albedo {
        Albedo::Constant(albedo) => albedo.rgb.map(|a| 1.0 - a),
        Albedo::PerVoxel(_) => [1.0; 3],
    }
}

/// The way of a pencil beam through the box; `None` if it misses.
pub fn beam(scene: &Scene, position: [f64; 3], direction: [f64; 3]) -> Option<Way> {
    let volume = &scene.medium.volume;
    let (h, n) = (volume.spacing(), volume.n());
    let start = volume.local(position);
    let p: [f64; 3] = std::array::from_fn(|a| start[a] / h[a]);
    let v: [f64; 3] = std::array::from_fn(|a| direction[a] / h[a]);
    let (enter, leave) = super::track::enter(p, v, n.map(|m| m as i32))?;
    let p = std::array::from_fn(|a| (p[a] + v[a] * enter).clamp(0.0, n[a] as f64));
    Some(Way { p, v, length: leave - enter })
}

/// What a pencil beam of power 1 leaves in the voxels: `leave(cell, path, absorbed)`, by channel.
pub fn over_beam(
    scene: &Scene,
    position: [f64; 3],
    direction: [f64; 3],
    leave: impl FnMut([usize; 3], [f64; 3], [f64; 3]),
) {
    let Some(way) = beam(scene, position, direction) else { return };
    if scene.medium.is_chromatic() {
        over_way::<3>(scene, &way, leave);
    } else {
        over_way::<1>(scene, &way, leave);
    }
}

fn over_way<const K: usize>(scene: &Scene, way: &Way, mut leave: impl FnMut([usize; 3], [f64; 3], [f64; 3])) {
    let coalbedo = coalbedo(scene);
    Matter::<K>::new(scene).walk(way, DARK, |cell, stay| {
        let absorbed = std::array::from_fn(|c| stay.absorbed[c % K] * coalbedo[c]);
        leave(cell.map(|c| c as usize), std::array::from_fn(|c| stay.path[c % K]), absorbed);
    });
}

/// The cosine between two unit vectors.
#[inline(always)]
pub fn cosine(a: V3, b: V3) -> f32 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0)
}
