//! Where photons start: at a light, within an emitting medium, or at their first collision.

use super::light::Illumination;
use super::track::enter;
use super::unscattered::beam;
use crate::physics::Real;
use crate::physics::frame::{rotate, sphere};
use crate::physics::rng::{Draws, uniform64};
use crate::physics::solid_angle::box_solid_angle;
use crate::plan::{Direct, Emission, LightPlan};
use crate::scene::environment::{Shower, per_mean, weights};
use crate::scene::field::{Field, V3};
use crate::scene::{Light, Scene};
use rayon::prelude::*;
use std::f64::consts::PI;

/// A photon at its start.
#[derive(Debug, Clone, Copy)]
pub enum Start {
    /// It does not meet the box.
    Miss,
    /// It enters the box (or starts within) and flies.
    Flight {
        /// Voxel coordinates.
        p: V3,
        /// Unit direction.
        direction: V3,
    },
    /// It does so with weights by channel of its own (those of lights of many colours).
    Coloured {
        /// Voxel coordinates.
        p: V3,
        /// Unit direction.
        direction: V3,
        /// Weight relative to the emitter's mean photon, by channel.
        weight: [f32; 3],
    },
    /// It is at its first collision, with weights by channel.
    Collision {
        /// Voxel coordinates.
        p: V3,
        /// Unit direction before the collision.
        direction: V3,
        /// Weight relative to the emitter's mean photon, by channel.
        weight: [f32; 3],
    },
}

/// How an emitter places its photons.
pub(in crate::backend) enum Kind<'a> {
    Point { position: [f64; 3], axis: [f64; 3], cap: f64 },
    Pencil { p: V3, direction: [f64; 3] },
    Directional { direction: [f64; 3], faces: [f64; 3] },
    Environment { faces: [f64; 3] },
    Map { shower: Shower<'a>, faces: [f64; 3] },
    Medium(Glowing<'a>),
    FirstCollision(FirstCollisions<'a>),
}

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

/// An emitting medium, whose voxels are drawn by what they emit in all channels together, each over its mean.
pub(in crate::backend) struct Glowing<'a> {
    pub(in crate::backend) fields: Vec<Field<'a>>,
    /// What makes each field's mean 1; 0 where it is dark.
    pub(in crate::backend) factors: [f32; 3],
    /// Sums of the voxels' values up to the end of each row along x.
    pub(in crate::backend) rows: Vec<f64>,
    n: [usize; 2],
}

impl<'a> Glowing<'a> {
    fn new(fields: Vec<Field<'a>>, means: [f64; 3]) -> Self {
        let n = fields[0].n().map(|m| m as usize);
        let factors = per_mean(&means[..fields.len()]);
        let mut rows: Vec<f64> = (0..n[1] * n[2])
            .into_par_iter()
            .map(|row| (row * n[0]..(row + 1) * n[0]).map(|at| sum_of(&fields, &factors, at)).sum())
            .collect();
        let mut total = 0.0;
        for row in &mut rows {
            total += *row;
            *row = total;
        }
        Glowing { fields, factors, rows, n: [n[0], n[1]] }
    }

    /// The voxel at the part `u` of all emission.
    fn find(&self, u: f64) -> [usize; 3] {
        let target = u * self.rows[self.rows.len() - 1];
        let row = self.rows.partition_point(|&sum| sum <= target).min(self.rows.len() - 1);
        let mut rest = target - if row > 0 { self.rows[row - 1] } else { 0.0 };
        let [nx, ny] = self.n;
        // Rounding may run over the end of the row: then the last voxel that emits.
        let mut found = 0;
        for i in 0..nx {
            let value = sum_of(&self.fields, &self.factors, row * nx + i);
            if value > 0.0 {
                found = i;
                if rest < value {
                    break;
                }
                rest -= value;
            }
        }
        [found, row % ny, row / ny]
    }

    /// A place of a voxel's light, from six uniform numbers: uniform over it, or distributed as its hat of interpolation, the
    /// sum of two uniform numbers, which is folded back at the box's faces (where values are clamped).
    fn place(&self, voxel: [usize; 3], xi: [f64; 6]) -> [f64; 3] {
        let n = self.fields[0].n();
        std::array::from_fn(|a| {
            let low = voxel[a] as f64;
            if !self.fields[0].linear() {
                return low + xi[a];
            }
            let p = (low + xi[a] + xi[a + 3] - 0.5).abs();
            let top = f64::from(n[a]);
            if p > top { 2.0 * top - p } else { p }
        })
    }

    /// The weight of each channel at a point.
    fn colour(&self, p: V3) -> [f32; 3] {
        let values = std::array::from_fn(|c| self.fields[c % self.fields.len()].at(p));
        weights(values, self.factors)
    }
}

/// The sum of some fields in a voxel, each times its factor.
#[inline(always)]
pub(in crate::backend) fn sum_of(fields: &[Field], factors: &[f32; 3], at: usize) -> f64 {
    fields.iter().zip(factors).map(|(field, &factor)| f64::from(field.values()[at] * factor)).sum()
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

impl FirstCollisions<'_> {
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

/// A light as the walk sees it.
pub struct Emitter<'a> {
    pub(in crate::backend) kind: Kind<'a>,
    /// The power of all its photons [W], by channel.
    pub powers: [f64; 3],
    /// Whether its order 0 is tallied.
    pub tallies_unscattered: bool,
    n: [i32; 3],
    h: [f64; 3],
}

impl<'a> Emitter<'a> {
    /// The emitter of a light, `None` where it shoots nothing or misses the box altogether.
    pub fn new(
        scene: &'a Scene<'a>,
        light: &'a Light,
        plan: &LightPlan,
        view: Option<&Illumination<'a>>,
    ) -> Option<Self> {
        let volume = &scene.medium.volume;
        let (size, h) = (volume.size(), volume.spacing());
        let value = light.value();
        if plan.emission == Emission::Nothing || value.max() == 0.0 {
            return None;
        }
        let areas = [size[1] * size[2], size[2] * size[0], size[0] * size[1]];
        let (kind, powers) = match (plan.emission, light) {
            (Emission::FirstCollision, _) => first_collisions(scene, view?, value.rgb, plan.interpolated_starts)?,
            (_, Light::Point { position, .. }) => {
                let (axis, cap) = cone(volume.local(*position), size);
                (Kind::Point { position: volume.local(*position), axis, cap }, value.rgb.map(|v| 2.0 * PI * cap * v))
            }
            (_, Light::Pencil { position, direction, .. }) => {
                let p = beam(scene, *position, *direction)?.p.map(|c| c as f32);
                (Kind::Pencil { p, direction: *direction }, value.rgb)
            }
            (_, Light::Directional { direction, .. }) => {
                let faces: [f64; 3] = std::array::from_fn(|a| direction[a].abs() * areas[a]);
                let area = faces.iter().sum::<f64>();
                (Kind::Directional { direction: *direction, faces }, value.rgb.map(|v| area * v))
            }
            (_, Light::Environment { map: None, .. }) => (Kind::Environment { faces: areas }, light.launched(size)),
            (_, Light::Environment { map: Some(map), .. }) => {
                (Kind::Map { shower: Shower::new(map, size), faces: areas }, light.launched(size))
            }
        };
        let emitter = Emitter {
            kind,
            powers,
            tallies_unscattered: plan.direct == Direct::Sampled,
            n: volume.n().map(|m| m as i32),
            h,
        };
        (powers != [0.0; 3]).then_some(emitter)
    }

    /// The emitter of a medium that emits by itself, `None` where it does not.
    pub fn medium(scene: &Scene<'a>) -> Option<Self> {
        let volume = &scene.medium.volume;
        let emission = scene.medium.emission.as_ref()?;
        let powers = emission.power(volume);
        let fields = || (0..emission.channels()).map(|c| emission.field(c, volume)).collect();
        (powers != [0.0; 3]).then(|| Emitter {
            kind: Kind::Medium(Glowing::new(fields(), emission.means(volume))),
            powers,
            tallies_unscattered: true,
            n: volume.n().map(|m| m as i32),
            h: volume.spacing(),
        })
    }

    /// The start of a photon; `u` within (0, 1) is stratified over the emitter's photons.
    #[inline]
    pub fn start(&self, u: f64, draws: &mut Draws) -> Start {
        let words = draws.next4();
        let (a, b) = (uniform64(words[0]), uniform64(words[1]));
        match &self.kind {
            Kind::Point { position, axis, cap } => {
                let v = cap * u;
                let direction = rotate(*axis, 1.0 - v, (v * (2.0 - v)).sqrt(), a);
                self.enter_box(*position, direction)
            }
            Kind::Pencil { p, direction } => Start::Flight { p: *p, direction: direction.map(|c| c as f32) },
            Kind::Directional { direction, faces } => {
                let (axis, rest) = pick_face(faces, u);
                let mut p = [0.0; 3];
                p[axis] = if direction[axis] > 0.0 { 0.0 } else { f64::from(self.n[axis]) };
                p[(axis + 1) % 3] = rest * f64::from(self.n[(axis + 1) % 3]);
                p[(axis + 2) % 3] = a * f64::from(self.n[(axis + 2) % 3]);
                Start::Flight { p: p.map(|c| c as f32), direction: direction.map(|c| c as f32) }
            }
            Kind::Environment { faces } => {
                let (axis, rest) = pick_face(faces, u);
                let (side, rest) = if rest < 0.5 { (0.0, 2.0 * rest) } else { (1.0, 2.0 * rest - 1.0) };
                let mut p = [0.0; 3];
                p[axis] = side * f64::from(self.n[axis]);
                p[(axis + 1) % 3] = rest * f64::from(self.n[(axis + 1) % 3]);
                p[(axis + 2) % 3] = a * f64::from(self.n[(axis + 2) % 3]);
                let mut inward = [0.0; 3];
                inward[axis] = 1.0 - 2.0 * side;
                // Lambertian entrance: cos^2 uniform.
                let direction = rotate(inward, b.sqrt(), (1.0 - b).sqrt(), uniform64(words[2]));
                Start::Flight { p: p.map(|c| c as f32), direction: direction.map(|c| c as f32) }
            }
            Kind::Map { shower, faces } => {
                let more = || {
                    let words = draws.next4();
                    [
                        uniform64(words[0]),
                        uniform64(words[1]),
                        (f64::from(words[2]) + uniform64(words[3])) / 4_294_967_296.0,
                    ]
                };
                let Some((sky, weight)) = shower.draw(u, more) else { return Start::Miss };
                let direction = sky.map(|c| -c);
                let (axis, rest) = pick_face(&std::array::from_fn(|a| direction[a].abs() * faces[a]), a);
                let mut p = [0.0; 3];
                p[axis] = if direction[axis] > 0.0 { 0.0 } else { f64::from(self.n[axis]) };
                p[(axis + 1) % 3] = rest * f64::from(self.n[(axis + 1) % 3]);
                p[(axis + 2) % 3] = b * f64::from(self.n[(axis + 2) % 3]);
                let (p, direction) = (p.map(|c| c as f32), direction.map(|c| c as f32));
                match shower.channels() {
                    1 => Start::Flight { p, direction },
                    _ => Start::Coloured { p, direction, weight },
                }
            }
            Kind::Medium(glowing) => {
                let more = draws.next4();
                let xi = [words[2], words[3], more[0], more[1], more[2], more[3]].map(uniform64);
                let place = glowing.place(glowing.find(u), xi);
                let p: V3 = std::array::from_fn(|a| place[a].clamp(0.0, f64::from(self.n[a])) as f32);
                let direction = sphere(a, b).map(|c| c as f32);
                match glowing.fields.len() {
                    1 => Start::Flight { p, direction },
                    _ => Start::Coloured { p, direction, weight: glowing.colour(p) },
                }
            }
            Kind::FirstCollision(first) => {
                let (voxel, share) = first.find(&mut Cursor::default(), u);
                let place = [a as f32, b as f32, uniform64(words[2]) as f32];
                let p = std::array::from_fn(|k| voxel[k] as f32 + place[k]);
                let (direction, weight) = first.arrive(p, share);
                Start::Collision { p, direction, weight }
            }
        }
    }

    /// The first collisions, where photons start at these.
    #[inline(always)]
    pub fn first_collisions(&self) -> Option<&FirstCollisions<'a>> {
        match &self.kind {
            Kind::FirstCollision(first) => Some(first),
            _ => None,
        }
    }

    fn enter_box(&self, position: [f64; 3], direction: [f64; 3]) -> Start {
        let p: [f64; 3] = std::array::from_fn(|a| position[a] / self.h[a]);
        let v: [f64; 3] = std::array::from_fn(|a| direction[a] / self.h[a]);
        match enter(p, v, self.n) {
            Some((t0, _)) => Start::Flight {
                p: std::array::from_fn(|a| (p[a] + v[a] * t0).clamp(0.0, f64::from(self.n[a])) as f32),
                direction: direction.map(|c| c as f32),
            },
            None => Start::Miss,
        }
    }
}

/// The axis of a face chosen by area from `u`, and the rest of `u` within it.
fn pick_face(areas: &[f64; 3], u: f64) -> (usize, f64) {
    let mut rest = u * areas.iter().sum::<f64>();
    for axis in 0..3 {
        if areas[axis] > 0.0 {
            if rest < areas[axis] {
                return (axis, rest / areas[axis]);
            }
            rest -= areas[axis];
        }
    }
    let last = (0..3).rev().find(|&a| areas[a] > 0.0).unwrap_or(0);
    (last, 1.0 - 1e-12)
}

/// The cone from a point around the box's bounding sphere: its axis, and 1 - the cosine of its half angle (2 for all
/// directions, from within the sphere).
pub(in crate::backend) fn cone(position: [f64; 3], size: [f64; 3]) -> ([f64; 3], f64) {
    let to: [f64; 3] = std::array::from_fn(|a| 0.5 * size[a] - position[a]);
    let d2 = to.iter().map(|c| c * c).sum::<f64>();
    let r2 = 0.25 * size.iter().map(|c| c * c).sum::<f64>();
    if d2 <= r2 {
        return ([0.0, 0.0, 1.0], 2.0);
    }
    (to.map(|c| c / d2.sqrt()), r2 / d2 / (1.0 + (1.0 - r2 / d2).sqrt()))
}

/// The solid angle within which the photons of a point light are sampled.
pub fn cone_solid_angle(position: [f64; 3], size: [f64; 3]) -> f64 {
    2.0 * PI * cone(position, size).1
}

/// The voxels' shares of the first collisions, and the power of all by channel: mean density times unscattered fluence at
/// the centre, of the channel whose part of its own power is largest there.
fn first_collisions<'a>(
    scene: &Scene<'a>,
    light: &Illumination<'a>,
    value: [f64; 3],
    interpolated: bool,
) -> Option<(Kind<'a>, [f64; 3])> {
    let volume = &scene.medium.volume;
    let n = volume.n();
    let extinction = scene.medium.extinction.rgb.map(|e| e as f32);
    let cubic = volume.voxel_volume() as f32;
    // The collisions in a voxel of a light whose channels all have the largest value, by channel.
    let largest = value.iter().copied().fold(0.0, f64::max);
    let collisions = |[i, j, k]: [usize; 3]| {
        let density = if light.occupied([i, j, k]) { mean_density(volume, [i, j, k]) } else { 0.0 };
        if density == 0.0 {
            return [0.0; 3];
        }
        let p = [i as f32 + 0.5, j as f32 + 0.5, k as f32 + 0.5];
        let incident = light.incident(p);
        let column = light.rough_column(p, &incident);
        extinction.map(|e| density * (e * largest as f32 * (-e * column).exp()) * incident.falloff * cubic)
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
    let factors = each.map(|sum| if sum > 0.0 { (total / sum * largest).min(f64::from(f32::MAX)) as f32 } else { 0.0 });
    let light = light.clone();
    let first =
        FirstCollisions { light, interpolated, power, rows, extinction, factors, volume: cubic, n: [n[0], n[1]] };
    (total > 0.0).then_some((Kind::FirstCollision(first), std::array::from_fn(|c| each[c] * (value[c] / largest))))
}

/// The mean density over a voxel: its own, or with interpolation the exact mean of the trilinear function, which is
/// (1/8, 6/8, 1/8) along each axis.
pub fn mean_density(volume: &crate::scene::Volume, voxel: [usize; 3]) -> f32 {
    let n = volume.n();
    let field = Field::density(volume);
    if !volume.linear() {
        return field.voxel(voxel.map(|c| c as i32));
    }
    let mut sum = 0.0;
    for (dz, wz) in [(-1, 0.125f32), (0, 0.75), (1, 0.125)] {
        for (dy, wy) in [(-1, 0.125f32), (0, 0.75), (1, 0.125)] {
            let y = (voxel[1] as i32 + dy).clamp(0, n[1] as i32 - 1);
            let z = (voxel[2] as i32 + dz).clamp(0, n[2] as i32 - 1);
            let x = voxel[0] as i32;
            let (left, right) = ((x - 1).max(0), (x + 1).min(n[0] as i32 - 1));
            let line = 0.125 * (field.voxel([left, y, z]) + field.voxel([right, y, z])) + 0.75 * field.voxel([x, y, z]);
            sum += wy * wz * line;
        }
    }
    sum
}

/// The part of a point light's directions that meets the box.
pub fn hit_fraction(scene: &Scene, position: [f64; 3]) -> f64 {
    let volume = &scene.medium.volume;
    box_solid_angle(volume.local(position), volume.size()) / (4.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Control;
    use crate::backend::views::{illuminations, light_grids};
    use crate::plan::{Plan, Settings};
    use crate::scene::{Albedo, Camera, Medium, Spectrum, Volume};

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
