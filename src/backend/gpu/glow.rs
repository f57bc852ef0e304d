//! What a medium emits, on the GPU: its source term as textures.

use super::device::Gpu;
use super::kernel::Binding;
use super::scene::Texture;
use crate::error::Result;
use crate::scene::Medium;

/// The source term of a medium that emits.
#[derive(Debug)]
pub struct Glow {
    planes: Vec<Texture>,
    texel: wgpu::Buffer,
    linear: bool,
}

/// Names of the planes.
const PLANES: [&str; 3] = ["emission_0", "emission_1", "emission_2"];

impl Glow {
    /// Uploads the source term of a medium, if it has one.
    pub fn new(gpu: &Gpu, medium: &Medium) -> Result<Option<Self>> {
        let Some(emission) = &medium.emission else { return Ok(None) };
        let volume = &medium.volume;
        let plane = |channel| Texture::new(gpu, emission.field(channel, volume).values(), volume.n());
        let planes = (0..emission.channels()).map(plane).collect::<Result<Vec<_>>>()?;
        let unit = |k: usize| planes.get(k).map_or(0.0, |plane| plane.unit);
        let texel = gpu.uniform(&[unit(0), unit(1), unit(2), 0.0])?;
        Ok(Some(Glow { planes, texel, linear: volume.linear() }))
    }

    /// The file that knows the source term.
    pub fn emission(&self) -> &'static str {
        if self.planes.len() == 1 { "emission_1" } else { "emission_3" }
    }

    /// The files that know what is seen of it along a ray.
    pub fn files(&self) -> [&'static str; 3] {
        [self.emission(), "glow", if self.linear { "glow_linear" } else { "glow_nearest" }]
    }

    /// For kernels.
    pub fn bindings(&self) -> impl Iterator<Item = (&'static str, Binding<'_>)> {
        let planes = PLANES.iter().zip(&self.planes).map(|(name, plane)| (*name, Binding::Texture(&plane.view)));
        planes.chain([("emission_texel", Binding::Buffer(&self.texel))])
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::GpuScene;
    use super::*;
    use crate::backend::cpu::emitted;
    use crate::backend::gpu::device::for_tests;
    use crate::physics::Phase;
    use crate::physics::rng::{Draws, uniform};
    use crate::scene::{Albedo, Camera, Emission, Scene, Spectrum, Volume};
    use bytemuck::{Pod, Zeroable};

    #[repr(C)]
    #[derive(Debug, Clone, Copy, Pod, Zeroable)]
    struct Line {
        p: [f32; 3],
        length: f32,
        v: [f32; 3],
        cells: u32,
    }

    #[repr(C)]
    #[derive(Debug, Clone, Copy, Pod, Zeroable)]
    struct Found {
        whole: [f32; 3],
        cut: [f32; 3],
        columns: [f32; 3],
        values: [f32; 3],
    }

    /// Lines that start in or on a box, in voxels, and end in it or leave it.
    fn lines(n: [usize; 3], h: [f64; 3]) -> Vec<Line> {
        let line = |i: u64| {
            let mut draws = Draws::new([4, 1], i, 0);
            let (a, b) = (draws.next4().map(uniform), draws.next4().map(uniform));
            let mut p: [f32; 3] = std::array::from_fn(|k| n[k] as f32 * a[k]);
            if i.is_multiple_of(2) {
                p[i as usize % 3] = 0.0;
            }
            let mut d: [f32; 3] = std::array::from_fn(|k| b[k] - if p[k] == 0.0 { 0.0 } else { 0.5 });
            if i.is_multiple_of(7) {
                d[(i as usize + 1) % 3] = 0.0;
            }
            let norm = d.iter().map(|c| c * c).sum::<f32>().sqrt();
            let length = if i.is_multiple_of(5) { 3.0 * a[3] } else { 3e38 };
            Line { p, length, v: std::array::from_fn(|k| d[k] / norm / h[k] as f32), cells: 1 + (i % 9) as u32 }
        };
        (0..2000).map(line).collect()
    }

    /// A medium whose density and emission have holes, steps and gradients.
    struct Case {
        n: [usize; 3],
        linear: bool,
        constant: bool,
        extinction: &'static [f64],
        planes: usize,
    }

    /// The largest differences to the CPU, of light, of integrals and of values, relative to these and a hundredth of the
    /// largest.
    fn differences(case: &Case) -> [f32; 3] {
        let gpu = Gpu::open("").expect("an adapter");
        let (n, h) = (case.n, [0.5, 1.0, 2.0]);
        let voxels = n.iter().product::<usize>();
        let hash = |i: usize| ((i * 7919 + 31) % 101) as f32 / 100.0;
        let density: Vec<f32> =
            (0..voxels).map(|i| if case.constant { 0.7 } else { (hash(i) - 0.3).max(0.0) }).collect();
        let values: Vec<f32> = (0..voxels * case.planes).map(|i| (hash(3 * i + 1) - 0.5).max(0.0) * 3.0).collect();
        let spectrum = |v: &[f64]| Spectrum::new(v, "value").expect("valid");
        let volume = Volume::new(&density, n, h, [0.0; 3], case.linear).expect("valid");
        let emission = Emission::new(&values, case.planes, &volume).expect("valid");
        let albedo = Albedo::Constant(spectrum(&[0.5]));
        let medium = Medium::new(volume, spectrum(case.extinction), albedo, Phase::Isotropic).expect("valid");
        let camera = Camera::perspective([9.0; 3], [2.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
        let scene = Scene::new(medium.emitting(Some(emission)), vec![], camera);
        let on_gpu = GpuScene::new(&gpu, &scene, scene.channels()).expect("it fits");
        let glow = Glow::new(&gpu, &scene.medium).expect("it fits").expect("it emits");
        let mut files = vec!["tests/glow"];
        files.extend(glow.files());
        let kernel = gpu.kernel(on_gpu.source(&files)).expect("it compiles");
        let lines = lines(n, h);
        let (input, output) =
            (gpu.buffer(&lines).expect("it fits"), gpu.empty(lines.len() as u64 * 48).expect("it fits"));
        let mut bindings = on_gpu.bindings();
        bindings.extend(glow.bindings());
        bindings.extend([("lines", Binding::Buffer(&input)), ("found", Binding::Buffer(&output))]);
        gpu.run(&kernel, &bindings, lines.len() as u64).expect("it runs");
        let found: Vec<Found> = gpu.read(&output, lines.len()).expect("it is read");
        let truth = emitted::Glow::new(&scene).expect("it emits");
        let mut pairs: [Vec<(f32, f32)>; 9] = Default::default();
        for (line, found) in lines.iter().zip(found) {
            assert_eq!(found.whole.map(f32::to_bits), found.cut.map(f32::to_bits), "{line:?}");
            let Line { p, v, length, .. } = *line;
            let light: [f32; 3] = match scene.channels() {
                1 => [truth.along::<1>(p, v, length)[0]; 3],
                _ => truth.along(p, v, length),
            };
            let fields = [0, 1, 2].map(|c| scene.medium.emission.as_ref().expect("it emits").field(c, &volume));
            for c in 0..3 {
                pairs[c].push((found.whole[c], light[c]));
                pairs[3 + c].push((found.columns[c], fields[c].column(p, v, length)));
                pairs[6 + c].push((found.values[c], fields[c].at(p)));
            }
        }
        let differences = pairs.map(|pairs| {
            let top = pairs.iter().fold(0.0f32, |top, (_, truth)| top.max(*truth));
            pairs.iter().fold(0.0f32, |worst, (found, truth)| worst.max((found - truth).abs() / (truth + 0.01 * top)))
        });
        [0, 3, 6].map(|at| differences[at..at + 3].iter().fold(0.0, |worst: f32, d| worst.max(*d)))
    }

    #[test]
    fn emitted_light_is_that_of_the_cpu() {
        if for_tests().is_none() {
            return;
        }
        let mut cases = Vec::new();
        for linear in [false, true] {
            for (extinction, planes) in [
                (&[0.0] as &[f64], 1),
                (&[0.4], 1),
                (&[300.0], 1),
                (&[1e5], 1),
                (&[2.0], 3),
                (&[0.1, 1.0, 40.0], 1),
                (&[0.1, 1.0, 40.0], 3),
                (&[0.0, 2.0, 1e4], 3),
            ] {
                for constant in [false, true] {
                    cases.push(Case { n: [7, 5, 6], linear, constant, extinction, planes });
                }
            }
            cases.push(Case { n: [1, 1, 1], linear, constant: true, extinction: &[2.0], planes: 1 });
            cases.push(Case { n: [90, 70, 80], linear, constant: false, extinction: &[0.1], planes: 1 });
            cases.push(Case { n: [300, 2, 1], linear, constant: false, extinction: &[0.02], planes: 3 });
        }
        for case in cases {
            let Case { n, linear, constant, extinction, planes } = case;
            let worst = differences(&case);
            let what = format!("{n:?} linear {linear} constant {constant} {extinction:?} {planes}: {worst:?}");
            println!("{what}");
            assert!(worst.iter().all(|&w| w < 1e-5), "{what}");
        }
    }
}
