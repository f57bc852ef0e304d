//! Where photons start: at a light, within an emitting medium, or at their first collision.

mod first_collisions;
mod glowing;

use super::light::Illumination;
use super::track::enter;
use super::unscattered::beam;
use crate::physics::frame::{rotate, sphere};
use crate::physics::rng::{Draws, uniform64};
use crate::physics::solid_angle::box_solid_angle;
use crate::plan::{Direct, Emission, LightPlan};
use crate::scene::environment::Shower;
use crate::scene::field::V3;
use crate::scene::{Light, Scene};
use std::f64::consts::PI;

pub use first_collisions::{Cursor, FirstCollisions};
pub(in crate::backend) use glowing::{Glowing, sum_of};

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
            (Emission::FirstCollision, _) => {
                let (first, powers) = FirstCollisions::new(scene, view?, value.rgb, plan.interpolated_starts)?;
                (Kind::FirstCollision(first), powers)
            }
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

/// The part of a point light's directions that meets the box.
pub fn hit_fraction(scene: &Scene, position: [f64; 3]) -> f64 {
    let volume = &scene.medium.volume;
    box_solid_angle(volume.local(position), volume.size()) / (4.0 * PI)
}
