//! What the rays of a light leave in the voxels.

use super::aim::{Aim, Row};
use super::tally::{Set, Sums, Units, WHOLE, exponent, power_of_2};
use super::vacuum::Vacuum;
use super::walk::{DARK, Matter, Way};
use super::{cosine, shift};
use crate::backend::Control;
use crate::error::{Error, Result};
use crate::physics::Phase;
use crate::physics::lattice::Lattice;
use crate::plan::{REPLICATES, Rays};
use crate::scene::eye::LocalEye;
use crate::scene::field::V3;
use crate::scene::{Scene, Volume};
use crate::tally::Moments;
use rayon::prelude::*;

/// What of a light's means over voxels is wanted.
#[derive(Clone, Copy, Default)]
pub struct Wanted<'a> {
    /// The fluence.
    pub fluence: bool,
    /// What is absorbed, where the albedo is constant all that collides.
    pub absorbed: bool,
    /// The fluence weighted by the phase function of its direction and that to an eye.
    pub seen: Option<(&'a Phase, LocalEye)>,
}

/// Means over voxels by extinction, and their spread, for a light of value 1; those that were wanted. Each voxel has a unit
/// of its own, so that no light is too weak for single precision.
pub struct Means {
    /// The fluence.
    pub fluence: Option<Moments>,
    /// Absorbed power density.
    pub absorbed: Option<Moments>,
    /// The fluence weighted by the phase function.
    pub seen: Option<Moments>,
    units: Units,
    scales: [f64; 3],
}

impl Means {
    /// The units that the three are given in, in a voxel.
    pub fn units(&self, cell: [usize; 3]) -> [f64; 3] {
        let unit = self.units.size(cell);
        self.scales.map(|scale| unit / scale)
    }
}

/// What a light leaves in the voxels, by rays of a lattice in each patch of a plane.
pub fn means<const K: usize>(
    scene: &Scene,
    (light, aim): (usize, &Aim),
    rays: Rays,
    seed: u64,
    wanted: Wanted,
    control: &Control,
) -> Result<Means> {
    let volume = &scene.medium.volume;
    let (n, values) = (volume.n(), volume.voxels() * K);
    let tally = Tally::<K>::new(scene, aim, wanted, control);
    let rows = aim.rows(rays.sparse);
    let vacuum = if rays.sparse {
        let (sums, lengths) = (tally.sums(values), Sums::new(volume.voxels(), 1));
        tally.send(&rows, Lattice::of(1.0), shift(seed, light, REPLICATES, true), &sums, Pass::Learns(&lengths))?;
        Vacuum::new::<K>(volume, aim, (&sums, tally.scales), &lengths)
    } else {
        None
    };
    let pass = vacuum.as_ref().map_or(Pass::Plain, Pass::Knows);
    let sums = tally.sums(values);
    let mut moments = sums.each_ref().map(|sums| sums.as_ref().map(|_| Moments::new(values)));
    for replicate in 0..REPLICATES {
        tally.send(&rows, rays.lattice, shift(seed, light, replicate, true), &sums, pass)?;
        for (sums, moments) in sums.iter().zip(&mut moments) {
            let (Some(sums), Some(moments)) = (sums, moments) else { continue };
            sums.check()?;
            let row = n[0] * K;
            let parts = moments.mean.par_chunks_mut(row).zip(moments.m2.par_chunks_mut(row)).enumerate();
            parts.for_each_init(
                || vec![0.0; row],
                |found, (at, (mean, m2))| {
                    sums.take(at * row, found);
                    found.iter_mut().for_each(|value| *value *= power_of_2(-WHOLE));
                    Moments::update(mean, m2, replicate + 1, found);
                },
            );
        }
    }
    let (units, scales) = (tally.units, tally.scales);
    if let Some(vacuum) = &vacuum {
        for (at, moments) in moments.iter_mut().enumerate() {
            let Some(moments) = moments else { continue };
            vacuum.add(at, moments, REPLICATES, |voxel| units.size(cell(n, voxel)) / scales[at]);
        }
    }
    let [fluence, absorbed, seen] = moments;
    Ok(Means { fluence, absorbed, seen, units, scales })
}

/// How rays are tallied.
struct Tally<'a, const K: usize> {
    aim: &'a Aim,
    matter: Matter<'a, K>,
    wanted: Wanted<'a>,
    units: Units,
    scales: [f64; 3],
    n: [usize; 3],
    h: [f64; 3],
    per_volume: f64,
    control: &'a Control,
}

/// What becomes of what rays leave.
#[derive(Clone, Copy)]
enum Pass<'a> {
    /// It is summed.
    Plain,
    /// The lengths of their ways too.
    Learns(&'a Sums),
    /// The part that is known without them is left out.
    Knows(&'a Vacuum),
}

impl<'a, const K: usize> Tally<'a, K> {
    fn new(scene: &'a Scene, aim: &'a Aim, wanted: Wanted<'a>, control: &'a Control) -> Self {
        let volume: &Volume = &scene.medium.volume;
        let h = volume.spacing();
        // Of light that fluence bounds, a voxel absorbs and sends to the eye at most so much.
        let absorbing = scene.medium.max_sigma_t().min(h.iter().map(|h| 1.0 / h).sum()).max(1e-300);
        let sent = wanted.seen.map_or(1.0, |(phase, _)| brightest(phase));
        Tally {
            aim,
            matter: Matter::new(scene),
            wanted,
            units: Units::new(volume, aim.source),
            scales: [1.0, absorbing, sent].map(|most| power_of_2(-exponent(most) - 1)),
            n: volume.n(),
            h,
            per_volume: 1.0 / volume.voxel_volume(),
            control,
        }
    }

    /// Sums of what is wanted.
    fn sums(&self, values: usize) -> [Option<Sums>; 3] {
        let exists = [self.wanted.fluence, self.wanted.absorbed, self.wanted.seen.is_some()];
        let tallies = exists.iter().filter(|&&exists| exists).count();
        exists.map(|exists| exists.then(|| Sums::new(values, tallies)))
    }

    /// Sends the rays of some rows.
    fn send(
        &self,
        rows: &[Row],
        lattice: Lattice,
        shift: [f64; 2],
        sums: &[Option<Sums>; 3],
        pass: Pass,
    ) -> Result<()> {
        let single = self.h.map(|h| h as f32);
        // Where the vacuum's part is taken off, the whole way counts.
        let dark = if matches!(pass, Pass::Plain) { DARK } else { -1.0 };
        rows.par_iter().for_each(|row| {
            if self.control.stopped() {
                return;
            }
            let sets = [0, 1, 2].map(|tally: usize| sums[tally].as_ref().map(Sums::set));
            let lengths = if let Pass::Learns(lengths) = pass { Some(lengths.set()) } else { None };
            let vacuum = if let Pass::Knows(vacuum) = pass { Some(vacuum) } else { None };
            self.aim.over_row(row, lattice, shift, &mut |way: &Way, flux: f64| {
                // A single cell next to a light may have many rays.
                if self.control.stopped() {
                    return;
                }
                let flux = flux * self.per_volume;
                let direction: V3 = std::array::from_fn(|a| (way.v[a] * self.h[a]) as f32);
                self.matter.walk(way, dark, |cell, stay| {
                    let voxel = (cell[2] as usize * self.n[1] + cell[1] as usize) * self.n[0] + cell[0] as usize;
                    let scale = flux * self.units.of(cell);
                    let add = |tally: usize, set: &Set, values: &[f64; K], factor: f64| {
                        let scale = scale * self.scales[tally];
                        for c in 0..K {
                            let at = voxel * K + c;
                            let known = vacuum.map_or(0.0, |vacuum| vacuum.share(tally, at) * stay.length);
                            set.add(at, (values[c] * factor - known) * scale);
                        }
                    };
                    if let Some(set) = &sets[0] {
                        add(0, set, &stay.path, 1.0);
                    }
                    if let Some(set) = &sets[1] {
                        add(1, set, &stay.absorbed, 1.0);
                    }
                    if let (Some(set), Some((phase, eye))) = (&sets[2], &self.wanted.seen) {
                        let toward = eye.from(cell.map(|c| c as f32 + 0.5), single);
                        add(2, set, &stay.path, f64::from(phase.pdf(cosine(toward, direction))));
                    }
                    if let Some(lengths) = &lengths {
                        lengths.add(voxel, stay.length * scale);
                    }
                });
            });
        });
        if self.control.stopped() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// The cell of a voxel.
fn cell(n: [usize; 3], voxel: usize) -> [usize; 3] {
    [voxel % n[0], voxel / n[0] % n[1], voxel / (n[0] * n[1])]
}

/// About the largest value of a phase function.
fn brightest(phase: &Phase) -> f64 {
    (0..=256).map(|i| f64::from(phase.pdf(i as f32 / 128.0 - 1.0))).fold(0.0, f64::max)
}
