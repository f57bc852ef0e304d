//! Sky maps on the GPU. What is drawn there has the density that is said there, exactly: both come from the same
//! integers, the parts of importance by row and texel in 2^-31, which no texel that is not dark has none of.

use super::device::Gpu;
use super::kernel::Binding;
use crate::error::Result;
use crate::scene::environment::Map;
use bytemuck::{Pod, Zeroable};
use std::f64::consts::PI;

/// `Map` of `shaders/map.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Entry {
    pub width: u32,
    pub height: u32,
    pub channels: u32,
    pub values: u32,
    pub sums: u32,
    pub spare: u32,
}

/// The maps of a kernel, in their order: the shader file is "map".
#[derive(Debug)]
pub struct Maps {
    list: wgpu::Buffer,
    values: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// How many there are.
    pub count: u32,
}

impl Maps {
    /// Uploads maps.
    pub fn new<'a>(gpu: &Gpu, maps: impl Iterator<Item = &'a Map>) -> Result<Self> {
        let (mut list, mut values, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        for map in maps {
            let [width, height] = map.size();
            list.push(Entry {
                width: width as u32,
                height: height as u32,
                channels: map.channels() as u32,
                values: values.len() as u32,
                sums: sums.len() as u32,
                spare: 0,
            });
            values.extend_from_slice(map.texels());
            // 1 - cos(theta) = 2 sin^2(theta / 2).
            let edge = |row: usize| 2.0 * (0.5 * PI * row as f64 / height as f64).sin().powi(2);
            values.extend((0..=height).map(|row| edge(row) as f32));
            let dark = map.texels().iter().all(|&v| v == 0.0);
            let unit = if dark { 0.0 } else { 2f64.powi(-62) };
            values.extend((0..height).map(|row| (unit / map.solid_angle(row)) as f32));
            sums.extend(map.importance().into_iter().flatten());
        }
        let count = list.len() as u32;
        list.resize(list.len().max(1), Entry::default());
        Ok(Maps { list: gpu.buffer(&list)?, values: gpu.buffer(&values)?, sums: gpu.buffer(&sums)?, count })
    }

    /// For kernels.
    pub fn bindings(&self) -> [(&'static str, Binding<'_>); 3] {
        [
            ("maps", Binding::Buffer(&self.list)),
            ("map_values", Binding::Buffer(&self.values)),
            ("map_sums", Binding::Buffer(&self.sums)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::Source;
    use super::*;
    use crate::physics::rng::{Draws, uniform};

    /// What the shader found for a direction, the first two coordinates of which serve as uniform numbers too.
    #[repr(C)]
    #[derive(Debug, Clone, Copy, Pod, Zeroable)]
    struct Found {
        drawn: [f32; 3],
        density: f32,
        density_again: f32,
        density_there: f32,
        radiance_there: [f32; 3],
        radiance_again: [f32; 3],
    }

    fn found(gpu: &Gpu, maps: &Maps, map: u32, given: &[[f32; 4]]) -> Vec<Found> {
        let kernel = gpu.kernel(Source::new(["tests/map", "map", "real", "phase"])).expect("it compiles");
        let output = gpu.empty(given.len() as u64 * 48).expect("it fits");
        let job = gpu.uniform(&[map, 0, 0, 0]).expect("it fits");
        let input = gpu.buffer(given).expect("it fits");
        let mut bindings = maps.bindings().to_vec();
        bindings.extend([("job", &job), ("given", &input), ("found", &output)].map(|(n, b)| (n, Binding::Buffer(b))));
        gpu.run(&kernel, &bindings, given.len() as u64).expect("it runs");
        gpu.read(&output, given.len()).expect("it is read")
    }

    /// A map with dark parts, a gradient and a sun of the given brightness.
    fn sky(width: usize, height: usize, channels: usize, sun: f32) -> Map {
        let value = |i: usize| if i % 5 == 3 { 0.0 } else { (((i + 1) * 7919) % 101) as f32 / 20.0 };
        let mut texels: Vec<f32> = (0..width * height * channels).map(value).collect();
        texels[channels * (width * height / 3)] = sun;
        Map::new(texels, width, height, channels).expect("valid")
    }

    /// Directions all over the sphere, and those along the axes.
    fn directions() -> Vec<[f32; 4]> {
        let mut list = vec![[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]];
        list.extend([[-1.0, 0.0, 0.0, 0.0], [1e-6, -1e-7, 1.0, 0.0], [-3e-7, 2e-6, -1.0, 0.0]]);
        for i in 0..4000 {
            let words = Draws::new([1, 2], i, 0).next4();
            let (z, turn) = (f64::from(2.0 * uniform(words[0]) - 1.0), 2.0 * PI * f64::from(uniform(words[1])));
            let s = (1.0 - z * z).sqrt();
            list.push([(s * turn.cos()) as f32, (s * turn.sin()) as f32, z as f32, 0.0]);
        }
        list
    }

    #[test]
    fn maps_are_those_of_the_cpu() {
        let gpu = Gpu::open("").expect("an adapter");
        let mut all: Vec<Map> = [(1, 1, 1), (2, 1, 1), (1, 2, 3), (7, 5, 1), (16, 9, 3), (33, 18, 1), (64, 32, 3)]
            .map(|(w, h, c)| sky(w, h, c, 500.0))
            .into();
        all.push(Map::new(vec![0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 6, 1, 1).expect("valid"));
        let maps = Maps::new(&gpu, all.iter()).expect("it fits");
        assert_eq!(maps.count, 8);
        let given = directions();
        for (at, map) in all.iter().enumerate() {
            let top = map.max().iter().fold(0.0, |m: f64, &v| m.max(v)) as f32;
            // A direction is known to some 3e-7; the radiance changes by `top` over a texel.
            let [width, height] = map.size();
            let steep = 1e-6 * top * width.max(height) as f32;
            let (mut drawn, mut density, mut radiance, mut crossed) = (0.0f32, 0.0f32, 0.0f32, 0);
            for (d, found) in given.iter().zip(found(&gpu, &maps, at as u32, &given)) {
                let towards = [d[0], d[1], d[2]];
                let (truth, pdf) = map.sample(d[0].abs(), d[1].abs());
                for (one, other) in found.drawn.iter().zip(truth) {
                    // Next to a pole 1 - |cos theta| is known to 6e-8.
                    let sine = truth[0].hypot(truth[1]).max(3e-4);
                    drawn = drawn.max((one - other).abs() * sine);
                }
                density = density.max((found.density / pdf - 1.0).abs());
                let mut same = |found: f32, truth: f32| match truth {
                    truth if (found - truth).abs() <= 1e-5 * truth => {}
                    _ => crossed += 1,
                };
                same(found.density_there, map.pdf(towards));
                same(found.density_again, map.pdf(found.drawn));
                for c in 0..3 {
                    let mut near = |found: f32, truth: f32| radiance = radiance.max((found - truth).abs());
                    near(found.radiance_there[c], map.radiance(towards)[c]);
                    near(found.radiance_again[c], map.radiance(found.drawn)[c]);
                }
            }
            let what = format!("{width} x {height}: {drawn:e} {density:e} {:e} {crossed}", radiance / top);
            println!("{what}");
            assert!(drawn < 2e-6 && density < 1e-5 && radiance <= steep, "{what}");
            // Rounding puts what lies on an edge into a texel or its neighbour.
            assert!(crossed <= 4 + given.len() / 1000, "{what}");
        }
    }

    #[test]
    fn what_is_drawn_has_the_density_that_is_said() {
        let gpu = Gpu::open("").expect("an adapter");
        // A sun that leaves next to nothing to all else: 2^-31 of a row is less than what some texels have.
        let map = sky(12, 7, 1, 1e9);
        let maps = Maps::new(&gpu, std::iter::once(&map)).expect("it fits");
        let given = directions();
        let mut lit = 0;
        let (mut mean, mut square) = (0.0f64, 0.0f64);
        for (d, found) in given.iter().zip(found(&gpu, &maps, 0, &given)) {
            assert!(found.density_there > 0.0 || found.radiance_there[0] == 0.0, "{d:?}");
            lit += usize::from(found.density_again == found.density);
            let part = f64::from(found.density_there) * 4.0 * PI;
            (mean, square) = (mean + part, square + part * part);
        }
        // Rounding puts what lies on an edge into a texel or its neighbour.
        assert!(lit + 4 >= given.len(), "{lit}");
        let count = given.len() as f64;
        let error = ((square / count - (mean / count).powi(2)) / count).sqrt();
        assert!((mean / count - 1.0).abs() < 4.0 * error, "{} +- {error}", mean / count);
        let [rows, cells] = map.importance();
        let parts = |ends: &[u32]| (0..ends.len()).map(|i| ends[i] - if i > 0 { ends[i - 1] } else { 0 }).collect();
        let rows: Vec<u32> = parts(&rows);
        let mut whole = 0.0;
        for (row, line) in cells.chunks(12).enumerate() {
            let line: Vec<u32> = parts(line);
            for (column, &part) in line.iter().enumerate() {
                let angle = (2.0 * PI * (column as f64 + 0.5) / 12.0, PI * (row as f64 + 0.5) / 7.0);
                let d = [-angle.1.sin() * angle.0.sin(), -angle.1.sin() * angle.0.cos(), angle.1.cos()];
                let chance = f64::from(rows[row]) * f64::from(part) * 2f64.powi(-62);
                let truth = f64::from(map.pdf(d.map(|c| c as f32))) * map.solid_angle(row);
                assert!(
                    (chance - truth).abs() < 12.0 * 2f64.powi(-31) + 1e-6 * truth && (chance > 0.0) == (truth > 0.0)
                );
                whole += chance;
            }
        }
        assert!((whole - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_dark_map_has_no_density() {
        let gpu = Gpu::open("").expect("an adapter");
        let map = Map::new(vec![0.0; 12], 4, 3, 1).expect("valid");
        let maps = Maps::new(&gpu, std::iter::once(&map)).expect("it fits");
        for found in found(&gpu, &maps, 0, &directions()) {
            let all = [found.density, found.density_there, found.radiance_there[0], found.radiance_again[0]];
            assert!(all.iter().all(|&v| v == 0.0) && found.drawn.iter().all(|c| c.is_finite()), "{found:?}");
        }
    }
}
