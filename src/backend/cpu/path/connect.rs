//! Connections: the light that reaches a vertex of a path straight from a source and scatters along the path.
//!
//! A path runs against the light. At a vertex that it reached along `travel`, light that travels along `l` scatters into it
//! by P(-l . travel).

use crate::backend::cpu::light::{Illumination, Source};
use crate::physics::frame::rotate;
use crate::physics::rng::{Draws, uniform};
use crate::physics::{Phase, Real};
use crate::plan::{Connection, Plan};
use crate::scene::Light;
use crate::scene::ViewRay;
use crate::scene::environment::Map;
use crate::scene::field::{Field, V3, along};
use std::f32::consts::FRAC_1_PI;

/// The directions of a joint connection: half by the phase function, half by 1 / sine of the angle to the light.
const TOWARDS_LIGHT: f32 = 0.5;

/// A light that vertices are connected to.
pub struct Lit<'a> {
    /// The light seen from within.
    pub view: Illumination<'a>,
    /// The chance of a correcting light ray; 1 where every connection takes one.
    pub check: f32,
}

/// All lights as a path finds them.
pub struct Connections<'a> {
    /// Lights that every vertex is connected to.
    pub far: Vec<Lit<'a>>,
    /// Lights in the medium or next to it.
    pub near: Vec<Illumination<'a>>,
    /// Radiance that is met on leaving the volume wherever that is, by channel.
    pub background: [f32; 3],
    /// Radiance that is met by direction.
    pub maps: Vec<&'a Map>,
    /// Extinction per density, by channel.
    pub extinction: [f32; 3],
    field: Field<'a>,
    phase: &'a Phase,
    h: V3,
}

impl<'a> Connections<'a> {
    /// Those of a plan; `views` are its lights seen from within.
    pub fn new(plan: &'a Plan<'a>, field: Field<'a>, views: &[Option<Illumination<'a>>]) -> Self {
        let medium = &plan.scene.medium;
        let (mut far, mut near) = (Vec::new(), Vec::new());
        let (mut background, mut maps) = ([0.0; 3], Vec::new());
        let connections = plan.paths.iter().flat_map(|paths| &paths.connections);
        for ((light, view), how) in plan.scene.lights.iter().zip(views).zip(connections) {
            if light.value().max() == 0.0 {
                continue;
            }
            match (how, view, light) {
                (Connection::Corrected(check), Some(view), _) => far.push(Lit { view: view.clone(), check: *check }),
                (Connection::Ray, Some(view), _) => far.push(Lit { view: view.clone(), check: 1.0 }),
                (Connection::Near, Some(view), _) => near.push(view.clone()),
                (_, _, Light::Environment { map: Some(map), .. }) => maps.push(map.as_ref()),
                (_, _, Light::Environment { radiance, map: None }) => {
                    for c in 0..3 {
                        background[c] += radiance.rgb[c] as f32;
                    }
                }
                _ => {}
            }
        }
        Connections {
            far,
            near,
            background,
            maps,
            extinction: medium.extinction.rgb.map(|e| e as f32),
            field,
            phase: &medium.phase,
            h: medium.volume.spacing().map(|c| c as f32),
        }
    }

    /// Whether light is met on leaving the volume.
    pub fn has_background(&self) -> bool {
        !self.maps.is_empty() || self.background.iter().any(|&b| b > 0.0)
    }

    /// What a path meets that leaves the volume along `d`, drawn with the density `chance` per steradian: of a map the part
    /// that the balance heuristic leaves to this way of finding it.
    #[inline(always)]
    pub fn met(&self, d: V3, chance: f32) -> [f32; 3] {
        let mut sum = self.background;
        for map in &self.maps {
            let part = chance / (chance + map.pdf(d)).max(1e-30);
            let radiance = map.radiance(d);
            for c in 0..3 {
                sum[c] += part * radiance[c];
            }
        }
        sum
    }

    /// The radiance of a map that is scattered along the path at a vertex, over the albedo there, from a direction drawn from
    /// the map: the other part.
    #[inline(always)]
    pub fn under_map(&self, map: &Map, p: V3, travel: V3, words: [u32; 4]) -> [f32; 3] {
        let (d, density) = map.sample(uniform(words[0]), uniform(words[1]));
        let cos_theta = d[0] * travel[0] + d[1] * travel[1] + d[2] * travel[2];
        let phase = self.phase.pdf(cos_theta.clamp(-1.0, 1.0));
        if density <= 0.0 || phase <= 0.0 {
            return [0.0; 3];
        }
        let radiance = map.radiance(d);
        let v: V3 = std::array::from_fn(|a| d[a] / self.h[a]);
        let through = self.through(self.field.column(p, v, f32::INFINITY));
        std::array::from_fn(|c| radiance[c] * through[c] * phase / (phase + density))
    }

    /// Transmittance of a column density, by channel.
    #[inline(always)]
    fn through(&self, column: f32) -> [f32; 3] {
        self.extinction.map(|e| Real::exp(-e * column))
    }

    /// The radiance that all far lights scatter along the path at a vertex, over the albedo there.
    #[inline(always)]
    pub fn scattered(&self, p: V3, travel: V3, draws: &mut Draws) -> [f32; 3] {
        let mut sum = [0.0f32; 3];
        for light in &self.far {
            let incident = light.view.incident(p);
            let l = incident.direction;
            let cos_theta = -(l[0] * travel[0] + l[1] * travel[1] + l[2] * travel[2]);
            let scale = self.phase.pdf(cos_theta.clamp(-1.0, 1.0)) * incident.falloff;
            let mut through = self.through(light.view.column(p, &incident));
            if light.check < 1.0 && uniform(draws.next4()[0]) <= light.check {
                let exact = self.through(light.view.ray(p, &incident));
                for c in 0..3 {
                    through[c] += (exact[c] - through[c]) / light.check;
                }
            }
            for c in 0..3 {
                sum[c] += light.view.value[c] * scale * through[c];
            }
        }
        sum
    }

    /// The light of a near light at a point `y` that the path comes to along `travel`, over its transmittance and without
    /// 1 / distance^2: value * P * transmittance of the way from the light, by channel.
    #[inline(always)]
    fn arriving(&self, light: &Illumination, y: V3, travel: V3) -> [f32; 3] {
        let incident = light.incident(y);
        let l = incident.direction;
        let cos_theta = -(l[0] * travel[0] + l[1] * travel[1] + l[2] * travel[2]);
        let p = self.phase.pdf(cos_theta.clamp(-1.0, 1.0));
        let through = self.through(light.ray(y, &incident));
        std::array::from_fn(|c| light.value[c] * p * through[c])
    }

    /// The light of a near light that is scattered once more beyond a vertex at `p`, where the path arrived along `travel`
    /// and scatters: over the albedos at both ends, `scatter` giving that at the further. Drawn jointly in direction and
    /// distance, so that 1 / distance^2 from the light is no part of its weight.
    #[inline(always)]
    pub fn once_more(
        &self,
        light: &Illumination,
        p: V3,
        travel: V3,
        words: [u32; 4],
        scatter: impl FnOnce(V3, u32) -> [f32; 3],
    ) -> [f32; 3] {
        let Source::Point(position) = light.source else { return [0.0; 3] };
        let to: V3 = std::array::from_fn(|a| (position[a] - p[a]) * self.h[a]);
        let way = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt().max(1e-20);
        let axis = to.map(|c| c / way);
        let direction = if words[3] & 1 == 0 {
            let (sin_theta, cos_theta) = (0.5 * uniform(words[0])).sin_cos_turn();
            rotate(axis, cos_theta, sin_theta, uniform(words[1]))
        } else {
            let (cos_theta, sin_theta) = self.phase.sample(uniform(words[0]));
            rotate(travel, cos_theta, sin_theta, uniform(words[1]))
        };
        let dot = |a: &V3, b: &V3| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (foot, cos_theta) = (dot(&to, &direction), dot(&direction, &travel).clamp(-1.0, 1.0));
        let off = (0..3).map(|a| (to[a] - foot * direction[a]).powi(2)).sum::<f32>().sqrt();
        let sin_light = (off / way).max(1e-6);
        let phase = self.phase.pdf(cos_theta);
        let chance = TOWARDS_LIGHT * (0.5 * FRAC_1_PI * FRAC_1_PI) / sin_light + (1.0 - TOWARDS_LIGHT) * phase;
        let v: V3 = std::array::from_fn(|a| direction[a] / self.h[a]);
        let length = self.field.leave(p, v).1;
        let Some(place) = Equiangular::new(foot, off, length) else { return [0.0; 3] };
        let t = place.at(uniform(words[2]));
        let y = along(p, v, t);
        let density = self.field.at(y);
        if density <= 0.0 {
            return [0.0; 3];
        }
        let between = self.through(self.field.column(p, v, t));
        let arriving = self.arriving(light, y, direction);
        // The light's 1 / distance^2 cancels against that in the density of t.
        let scale = phase / chance * place.spread() * density;
        let further = scatter(y, words[3] >> 1);
        std::array::from_fn(|c| scale * between[c] * arriving[c] * further[c] * self.extinction[c])
    }

    /// What a near light adds to a view ray by being scattered once, at a point drawn by its distance from the light, or at
    /// a first collision: over the albedo there, and by the balance heuristic of both.
    #[inline(always)]
    pub fn on_view(&self, light: &Illumination, ray: &ViewRay, spot: Spot, met: &Met) -> [f32; 3] {
        let density = self.field.at(spot.p);
        if density <= 0.0 {
            return [0.0; 3];
        }
        let Some(place) = equiangular_on(light, ray, self.h) else { return [0.0; 3] };
        let collision = met.density(spot.column) * density;
        let arriving = self.arriving(light, spot.p, ray.direction);
        let d2 = place.distance2(spot.t);
        let between = self.through(spot.column);
        // Both chances times d2: near the light the first is constant and the second vanishes.
        let scale = density / (1.0 / place.spread() + collision * d2);
        std::array::from_fn(|c| scale * self.extinction[c] * between[c] * arriving[c])
    }

    /// The point of a view ray at which it is looked at for a near light.
    #[inline(always)]
    pub fn spot(&self, light: &Illumination, ray: &ViewRay, xi: f32) -> Option<Spot> {
        let t = equiangular_on(light, ray, self.h)?.at(xi);
        let column = self.field.column(ray.p, ray.v, t);
        Some(Spot { p: along(ray.p, ray.v, t), t, column })
    }
}

/// A point of a view ray.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// In voxels.
    pub p: V3,
    /// Length from the ray's entry.
    pub t: f32,
    /// Column density up to it.
    pub column: f32,
}

/// What a view ray met: the chances of first collisions on it.
#[derive(Debug, Clone, Copy)]
pub struct Met {
    /// Channels whose extinctions differ.
    pub channels: usize,
    /// Extinction per density.
    pub extinction: [f32; 3],
    /// 1 - transmittance of the whole ray, by channel.
    pub opacity: [f32; 3],
}

impl Met {
    /// The density of first collisions per column density at a given one, the mean over the channels that may decide.
    #[inline(always)]
    pub fn density(&self, column: f32) -> f32 {
        let mut sum = 0.0;
        for c in 0..self.channels {
            sum += self.chance(c, column);
        }
        sum / self.channels as f32
    }

    /// The same under one channel.
    #[inline(always)]
    pub fn chance(&self, c: usize, column: f32) -> f32 {
        if self.opacity[c] > 0.0 {
            self.extinction[c] * Real::exp(-self.extinction[c] * column) / self.opacity[c]
        } else {
            0.0
        }
    }
}

/// Points on a line by the angle under which a light sees them (Kulla and Fajardo, *Importance sampling techniques for path
/// tracing in participating media*, EGSR 2012).
#[derive(Debug, Clone, Copy)]
struct Equiangular {
    foot: f32,
    off: f32,
    from: f32,
    to: f32,
    length: f32,
}

impl Equiangular {
    /// For a line of the given length, the point nearest to the light, and its distance from the light.
    #[inline(always)]
    fn new(foot: f32, off: f32, length: f32) -> Option<Self> {
        let off = off.max(1e-6 * length.max(foot.abs()));
        let (from, to) = ((-foot / off).atan(), ((length - foot) / off).atan());
        (to > from && off > 0.0).then_some(Equiangular { foot, off, from, to, length })
    }

    /// A point.
    #[inline(always)]
    fn at(&self, xi: f32) -> f32 {
        let angle = self.from + (self.to - self.from) * xi;
        (self.foot + self.off * angle.tan()).clamp(0.0, self.length)
    }

    /// The squared distance of a point from the light.
    #[inline(always)]
    fn distance2(&self, t: f32) -> f32 {
        self.off * self.off + (t - self.foot) * (t - self.foot)
    }

    /// 1 / (density of t * squared distance).
    #[inline(always)]
    fn spread(&self) -> f32 {
        (self.to - self.from) / self.off
    }
}

#[inline(always)]
fn equiangular_on(light: &Illumination, ray: &ViewRay, h: V3) -> Option<Equiangular> {
    let Source::Point(position) = light.source else { return None };
    let to: V3 = std::array::from_fn(|a| (position[a] - ray.p[a]) * h[a]);
    let d = ray.direction;
    let foot = to[0] * d[0] + to[1] * d[1] + to[2] * d[2];
    let off = (0..3).map(|a| (to[a] - foot * d[a]).powi(2)).sum::<f32>().sqrt();
    Equiangular::new(foot, off, ray.length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Column, Method, Settings};
    use crate::scene::{Albedo, Camera, Medium, Scene, Spectrum, Volume};
    use std::f64::consts::{PI, TAU};
    use std::sync::Arc;

    /// The side of the box, one voxel of hardly any density.
    const SIDE: f64 = 10.0;

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3).map(|i| a[i] * b[i]).sum()
    }

    /// Runs on the connections of paths to one light, in the box.
    fn connected(light: Light, g: f64, extinction: f64, test: impl FnOnce(&Connections, Option<&Illumination>)) {
        let grey = |value: f64| Spectrum::new(&[value], "value").expect("valid");
        let volume = Volume::new(&[1.0], [1; 3], [SIDE; 3], [0.0; 3], false).expect("valid");
        let phase = Phase::henyey_greenstein(g).expect("valid");
        let medium = Medium::new(volume, grey(extinction), Albedo::Constant(grey(1.0)), phase).expect("valid");
        let camera = Camera::perspective([40.0, 0.0, 0.0], [5.0; 3], [0.0, 0.0, 1.0], 30.0, [4, 4]).expect("valid");
        let scene = Scene::new(medium, vec![light], camera);
        let settings = Settings {
            method: Some(Method::Path),
            fluence: false,
            radiance: false,
            spp: Some(16),
            ..Settings::default()
        };
        let plan = Plan::new(&scene, &settings).expect("a plan");
        let views = [Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None)];
        test(&Connections::new(&plan, Field::density(&volume), &views), views[0].as_ref());
    }

    /// The middle of one of `n` equal parts of all words.
    fn word(part: u64, n: u64) -> u32 {
        ((part * 2 + 1) * (1 << 32) / (2 * n)) as u32
    }

    #[test]
    fn joint_connections_find_what_directions_and_distances_integrate_to() {
        let (p, lamp, travel) = ([2.5, 4.0, 6.5], [5.5, 3.0, 5.0], [0.48, -0.6, 0.64]);
        for g in [0.0, 0.6] {
            let extinction = 1e-6;
            let hg = |cosine: f64| (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine).powf(1.5) / (4.0 * PI);
            // Directions by their angle from the light, points on them by the angle under which the light sees them: what
            // is left is smooth but for the edges of the box.
            let to: [f64; 3] = std::array::from_fn(|a| lamp[a] - p[a]);
            let way = dot(to, to).sqrt();
            let axis = to.map(|c| c / way);
            let side = [axis[1], -axis[0], 0.0].map(|c| c / axis[0].hypot(axis[1]));
            let cross =
                [0, 1, 2].map(|a| axis[(a + 1) % 3] * side[(a + 2) % 3] - axis[(a + 2) % 3] * side[(a + 1) % 3]);
            let (polar, round, along) = (400, 200, 40);
            let mut truth = 0.0;
            for i in 0..polar {
                let (sin, cos) = (PI * (f64::from(i) + 0.5) / f64::from(polar)).sin_cos();
                for j in 0..round {
                    let (sin_phi, cos_phi) = (TAU * (f64::from(j) + 0.5) / f64::from(round)).sin_cos();
                    let d: [f64; 3] =
                        std::array::from_fn(|a| cos * axis[a] + sin * (cos_phi * side[a] + sin_phi * cross[a]));
                    let exit = (0..3).map(|a| if d[a] > 0.0 { (SIDE - p[a]) / d[a] } else { -p[a] / d[a] });
                    let length = exit.fold(f64::INFINITY, f64::min);
                    let (foot, off) = (way * cos, way * sin);
                    let (from, until) = ((-foot / off).atan(), ((length - foot) / off).atan());
                    let mut line = 0.0;
                    for k in 0..along {
                        let angle = from + (until - from) * (f64::from(k) + 0.5) / f64::from(along);
                        // Light that travels from the lamp to the point turns back along the way: sin(angle) = -cosine.
                        line += hg(-angle.sin()) * (until - from) / f64::from(along) / off;
                    }
                    truth += sin * PI / f64::from(polar) * TAU / f64::from(round) * hg(dot(d, travel)) * line;
                }
            }
            let light = Light::point(lamp, &[3.0]).expect("valid");
            connected(light, g, extinction, |connections, view| {
                let (n, mut sum) = (64, 0.0);
                let at = p.map(|c| (c / SIDE) as f32);
                for i in 0..n {
                    for j in 0..n {
                        for k in 0..n {
                            for half in 0..2 {
                                let words = [word(i, n), word(j, n), word(k, n), half];
                                let way = travel.map(|c| c as f32);
                                sum += f64::from(
                                    connections.once_more(view.expect("a point"), at, way, words, |_, _| [1.0; 3])[0],
                                );
                            }
                        }
                    }
                }
                let (value, truth) = (sum / (2 * n * n * n) as f64, 3.0 * extinction * truth);
                // Both grids are good to some 1e-4 of it.
                assert!((value / truth - 1.0).abs() < 2e-3, "g = {g}: {value} and not {truth}");
            });
        }
    }

    #[test]
    fn both_ways_to_find_a_map_add_up_to_all_of_its_light() {
        let texels: Vec<f32> = (0..24).map(|i| if i % 5 == 3 { 0.0 } else { ((i * 7919 + 1) % 101) as f32 }).collect();
        let map = Arc::new(Map::new(texels, 6, 4, 1).expect("valid"));
        let light =
            Light::Environment { radiance: Spectrum::new(&[1.0], "value").expect("valid"), map: Some(map.clone()) };
        let travel = [0.48f32, -0.6, 0.64];
        connected(light, 0.5, 1e-9, |connections, _| {
            let n = 1200;
            let (mut truth, mut met) = (0.0, 0.0);
            for i in 0..n {
                let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
                for j in 0..2 * n {
                    let (sin, cos) = (PI * (j as f64 + 0.5) / n as f64).sin_cos();
                    let s = (1.0 - z * z).sqrt();
                    let d = [s * sin, s * cos, z].map(|c| c as f32);
                    let cosine = (0..3).map(|a| d[a] * travel[a]).sum::<f32>();
                    let chance = connections.phase.pdf(cosine);
                    let area = 4.0 * PI / (2 * n * n) as f64;
                    truth += area * f64::from(chance * map.radiance(d)[0]);
                    met += area * f64::from(chance * connections.met(d, chance)[0]);
                }
            }
            let (n, mut sampled) = (1200, 0.0);
            for i in 0..n {
                for j in 0..n {
                    let words = [word(i, n), word(j, n), 0, 0];
                    sampled += f64::from(connections.under_map(&map, [0.5; 3], travel, words)[0]) / (n * n) as f64;
                }
            }
            assert!(met > 0.2 * truth && sampled > 0.2 * truth, "{met} and {sampled} of {truth}");
            // Both grids are good to some 1e-4 of it.
            assert!(((met + sampled) / truth - 1.0).abs() < 1e-3, "{met} + {sampled} and not {truth}");
        });
    }

    #[test]
    fn equiangular_density_integrates_to_one() {
        let place = Equiangular::new(0.7, 0.05, 2.0).expect("a line");
        let n = 200_000;
        let sum: f64 = (0..n)
            .map(|i| {
                let t = 2.0 * (i as f32 + 0.5) / n as f32;
                f64::from(1.0 / (place.spread() * place.distance2(t))) * 2.0 / f64::from(n)
            })
            .sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
        let (below, above) = (place.at(0.25), place.at(0.75));
        let part = (0..n).filter(|i| (below..above).contains(&(2.0 * (*i as f32 + 0.5) / n as f32)));
        let half: f64 = part
            .map(|i| {
                f64::from(1.0 / (place.spread() * place.distance2(2.0 * (i as f32 + 0.5) / n as f32))) * 2.0
                    / f64::from(n)
            })
            .sum();
        assert!((half - 0.5).abs() < 1e-3, "{half}");
    }
}
