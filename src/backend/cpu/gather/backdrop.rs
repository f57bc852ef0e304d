//! What is seen behind the volume.

use crate::scene::camera::Eye;
use crate::scene::environment::Map;
use crate::scene::{Camera, Light, Scene};

/// The environment behind the volume.
pub struct Backdrop<'a> {
    /// The sum of constant ones.
    pub constant: [f32; 3],
    /// The others.
    pub maps: Vec<&'a Map>,
}

impl<'a> Backdrop<'a> {
    /// That of a scene with an environment.
    pub fn new(scene: &'a Scene) -> Option<Self> {
        let mut backdrop = Backdrop { constant: [0.0; 3], maps: Vec::new() };
        let mut any = false;
        for light in &scene.lights {
            let Light::Environment { radiance, map } = light else { continue };
            any = true;
            match map {
                Some(map) => backdrop.maps.push(map),
                None => (0..3).for_each(|c| backdrop.constant[c] += radiance.rgb[c] as f32),
            }
        }
        any.then_some(backdrop)
    }

    /// Rays per pixel and axis that resolve the maps: four per texel.
    pub fn samples(&self, camera: &Camera) -> usize {
        // Of a perspective camera this is the angle of the pixel in the middle, its largest.
        let angle = match camera.eye() {
            Eye::Point(_) => camera.pixel_width(1.0),
            Eye::Direction(_) => return 1,
        };
        let rows = self.maps.iter().map(|map| map.size()[1].max(map.size()[0] / 2)).max().unwrap_or(0);
        let texels = angle * rows as f64 * std::f64::consts::FRAC_1_PI;
        (4.0 * texels).ceil().clamp(if rows > 0 { 4.0 } else { 1.0 }, 24.0) as usize
    }

    /// The mean radiance over a square of pixels with the corner (x, y), from `n` by `n` rays.
    pub fn mean(&self, camera: &Camera, (x, y): (f64, f64), side: f64, n: usize) -> [f32; 3] {
        let mut sum = self.constant;
        if self.maps.is_empty() {
            return sum;
        }
        let weight = 1.0 / (n * n) as f32;
        for at in 0..n * n {
            let place = |i: usize| side * (i as f64 + 0.5) / n as f64;
            let (_, d) = camera.ray(x + place(at % n), y + place(at / n));
            for map in &self.maps {
                let radiance = map.radiance(d.map(|c| c as f32));
                (0..3).for_each(|c| sum[c] += weight * radiance[c]);
            }
        }
        sum
    }
}
