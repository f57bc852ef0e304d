//! A scene on the GPU: its constants, its voxels as textures, and the shader files that say what kind of scene it is.

use super::device::Gpu;
use super::kernel::{Binding, Source};
use super::sources;
use crate::error::Result;
use crate::physics::Phase;
use crate::physics::rng::split;
use crate::plan::Plan;
use crate::scene::camera::Eye;
use crate::scene::{Albedo, Camera, Medium, Scene, Volume};
use bytemuck::{Pod, Zeroable};
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

/// `Scene` of `shaders/tables.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Constants {
    pub n: [i32; 3],
    pub block: i32,
    pub h: [f32; 3],
    pub free_path: f32,
    pub inverse_h: [f32; 3],
    pub top_extinction: f32,
    pub extinction: [f32; 3],
    pub texel: f32,
    pub albedo: [f32; 3],
    pub constant: f32,
    pub ratio: [f32; 3],
    pub albedo_texel: f32,
    pub cells: [i32; 3],
    pub last: u32,
    pub eye: [f32; 4],
    pub seed: [u32; 2],
    pub enough: f32,
    pub per_density: f32,
    pub hg: [f32; 4],
}

/// Voxels as a texture.
#[derive(Debug)]
pub struct Texture {
    /// For kernels.
    pub view: wgpu::TextureView,
    /// What a texel of 1 stands for.
    pub unit: f32,
}

impl Texture {
    /// The texture of values over a volume's voxels, in the smallest format that loses nothing.
    pub fn new(gpu: &Gpu, values: &[f32], n: [usize; 3]) -> Result<Self> {
        let (format, unit, texels) = pack(values);
        Ok(Texture { view: gpu.texture(n, format, &texels)?, unit })
    }
}

/// Values in the smallest format that loses nothing: bytes for what is a byte (or a 255th of one), half precision for what
/// that holds exactly, else single. With the value of a texel of 1.
fn pack(values: &[f32]) -> (wgpu::TextureFormat, f32, Vec<u8>) {
    for unit in [255.0f32, 1.0] {
        let bytes = values.iter().map(|&v| {
            let byte = (v * (255.0 / unit)).round();
            ((byte / 255.0) * unit == v && byte <= 255.0).then_some(byte as u8)
        });
        if let Some(bytes) = bytes.collect() {
            return (wgpu::TextureFormat::R8Unorm, unit, bytes);
        }
    }
    if let Some(halves) = values.iter().map(|&v| half(v)).collect::<Option<Vec<u16>>>() {
        return (wgpu::TextureFormat::R16Float, 1.0, bytemuck::cast_slice(&halves).to_vec());
    }
    (wgpu::TextureFormat::R32Float, 1.0, bytemuck::cast_slice(values).to_vec())
}

/// A non-negative number in half precision, if that is exact and normal.
fn half(value: f32) -> Option<u16> {
    let bits = value.to_bits();
    if bits == 0 {
        return Some(0);
    }
    let exponent = (bits >> 23) as i32 - 127;
    let exact = bits & 0x1fff == 0 && (-14..=15).contains(&exponent);
    exact.then(|| (((exponent + 15) as u32) << 10 | (bits >> 13 & 0x3ff)) as u16)
}

/// A scene's constants and voxels on the GPU.
#[derive(Debug)]
pub struct GpuScene {
    /// What `scene` holds in the shaders.
    pub constants: Constants,
    uniform: wgpu::Buffer,
    density: Option<Texture>,
    albedo: Option<Texture>,
    phase_table: Option<wgpu::Buffer>,
    files: Vec<&'static str>,
}

impl GpuScene {
    /// A scene to be looked at, uploaded unless it was the last.
    pub fn kept(gpu: &Gpu, scene: &Scene, channels: usize) -> Result<Arc<Self>> {
        gpu.kept((scene.id, channels), || GpuScene::new(gpu, scene, channels))
    }

    /// Uploads a scene.
    pub fn new(gpu: &Gpu, scene: &Scene, channels: usize) -> Result<Self> {
        let Medium { volume, albedo, .. } = &scene.medium;
        let mut files = sources::COMMON.to_vec();
        files.push(if channels == 1 { "channels_1" } else { "channels_3" });
        files.push(if volume.is_ball() { "edge_ball" } else { "edge_box" });
        files.push(if volume.linear() { "lookup_linear" } else { "lookup_nearest" });
        files.push(if volume.is_constant() { "density_constant" } else { "density_voxels" });
        files.push(if matches!(albedo, Albedo::Constant(_)) { "albedo_constant" } else { "albedo_voxels" });
        let mut phase_table = None;
        match &scene.medium.phase {
            phase if phase.is_isotropic() => files.push("phase_isotropic"),
            Phase::Isotropic => {}
            Phase::Rayleigh => files.push("phase_rayleigh"),
            Phase::HenyeyGreenstein { .. } => files.push("phase_hg"),
            Phase::Tabulated(table) => {
                files.push("phase_tabulated");
                let (values, len) = table.flat();
                phase_table = Some(gpu.buffer(&[&[len as f32], &values[..]].concat())?);
            }
        }
        let density = if volume.is_constant() { None } else { Some(Texture::new(gpu, volume.density(), volume.n())?) };
        let albedo = match albedo {
            Albedo::PerVoxel(values) => Some(Texture::new(gpu, values, volume.n())?),
            Albedo::Constant(_) => None,
        };
        let mut constants = constants(scene);
        constants.texel = density.as_ref().map_or(1.0, |t| t.unit);
        constants.albedo_texel = albedo.as_ref().map_or(1.0, |t| t.unit);
        let uniform = gpu.uniform(&constants)?;
        Ok(GpuScene { constants, uniform, density, albedo, phase_table, files })
    }

    /// Changes constants.
    pub fn update(&mut self, gpu: &Gpu, change: impl FnOnce(&mut Constants)) {
        change(&mut self.constants);
        gpu.write(&self.uniform, 0, &[self.constants]);
    }

    /// The kernel of the first of `files`, for this kind of scene.
    pub fn source(&self, files: &[&'static str]) -> Source {
        Source::new(files.iter().copied().chain(self.files.iter().copied()))
    }

    /// The scene's resources, for a kernel of it.
    pub fn bindings(&self) -> Vec<(&'static str, Binding<'_>)> {
        let mut list = vec![("scene", Binding::Buffer(&self.uniform))];
        let textures = [("density", &self.density), ("albedo_field", &self.albedo)];
        list.extend(textures.iter().filter_map(|(name, t)| t.as_ref().map(|t| (*name, Binding::Texture(&t.view)))));
        list.extend(self.phase_table.iter().map(|table| ("phase_table", Binding::Buffer(table))));
        list
    }
}

/// The constants that the scene alone decides.
fn constants(scene: &Scene) -> Constants {
    let medium = &scene.medium;
    let volume = &medium.volume;
    let (h, extinction) = (volume.spacing(), medium.extinction.rgb);
    let top = medium.extinction.max();
    let albedo = match medium.albedo {
        Albedo::Constant(a) => a.rgb,
        Albedo::PerVoxel(_) => [1.0; 3],
    };
    Constants {
        n: volume.n().map(|m| m as i32),
        block: 1,
        h: h.map(|c| c as f32),
        inverse_h: h.map(|c| (1.0 / c) as f32),
        top_extinction: top as f32,
        extinction: extinction.map(|e| e as f32),
        albedo: albedo.map(|a| a as f32),
        constant: volume.max(),
        per_density: 1.0 / volume.max().max(1e-30),
        ratio: extinction.map(|e| if top > 0.0 { (e / top) as f32 } else { 0.0 }),
        eye: eye(volume, &scene.camera),
        hg: match medium.phase {
            Phase::HenyeyGreenstein { g } => {
                let near = 1.0 - g.abs();
                [g, near, near * near, 0.25 * FRAC_1_PI * (1.0 - g * g)].map(|x| x as f32)
            }
            _ => [0.0; 4],
        },
        // What is behind 40 mean free paths is dark, in all channels.
        enough: (40.0 / extinction.iter().fold(f64::INFINITY, |m, &e| m.min(e))).min(1e38) as f32,
        ..Constants::default()
    }
}

/// The eye of a camera in voxel coordinates.
pub fn eye(volume: &Volume, camera: &Camera) -> [f32; 4] {
    match camera.eye() {
        Eye::Point(world) => {
            let (p, h) = (volume.local(world), volume.spacing());
            [(p[0] / h[0]) as f32, (p[1] / h[1]) as f32, (p[2] / h[2]) as f32, 1.0]
        }
        Eye::Direction(d) => [d[0] as f32, d[1] as f32, d[2] as f32, 0.0],
    }
}

/// The constants of a plan's random numbers and orders.
pub fn of_plan(plan: &Plan, constants: &mut Constants) {
    constants.seed = split(plan.settings.seed);
    constants.last = plan.walked_orders();
}

#[cfg(test)]
mod tests {
    use super::super::{adapter, device};
    use super::*;
    use crate::scene::Spectrum;

    #[test]
    fn the_scene_looked_at_last_is_uploaded_once() {
        if device::for_tests().is_none() {
            return;
        }
        // Of its own, which no other test looks at a scene with.
        let gpu = adapter::choose("").and_then(|adapter| Gpu::new(&adapter)).expect("it was there");
        let density = [0.0, 1.0];
        let scene = || {
            let volume = Volume::new(&density, [2, 1, 1], [1.0; 3], [0.0; 3], true).expect("valid");
            let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
            let medium = Medium::new(volume, grey(1.0), Albedo::Constant(grey(0.9)), Phase::Isotropic).expect("valid");
            let camera = Camera::perspective([9.0; 3], [1.0; 3], [0.0, 0.0, 1.0], 20.0, [3, 3]).expect("valid");
            Scene::new(medium, Vec::new(), camera)
        };
        let (one, other) = (scene(), scene());
        let again = one.holding(&crate::scene::Voxels { density: &density, ..Default::default() });
        let uploads = [&one, &again, &other, &one].map(|scene| GpuScene::kept(&gpu, scene, 1).expect("it fits"));
        assert!(Arc::ptr_eq(&uploads[0], &uploads[1]));
        assert!(!Arc::ptr_eq(&uploads[1], &uploads[2]) && !Arc::ptr_eq(&uploads[0], &uploads[3]));
    }

    #[test]
    fn packing_loses_nothing() {
        let bytes: Vec<f32> = (0..=255u8).map(f32::from).collect();
        assert_eq!(pack(&bytes).0, wgpu::TextureFormat::R8Unorm);
        let parts: Vec<f32> = (0..=255u8).map(|b| f32::from(b) / 255.0).collect();
        assert_eq!((pack(&parts).0, pack(&parts).1), (wgpu::TextureFormat::R8Unorm, 1.0));
        let halves = [0.0, 0.5, 1025.0, 6.103_515_6e-5, 65504.0];
        let (format, unit, texels) = pack(&halves);
        assert_eq!((format, unit), (wgpu::TextureFormat::R16Float, 1.0));
        for (texel, value) in texels.chunks(2).zip(halves) {
            let bits = u16::from_le_bytes([texel[0], texel[1]]);
            let (exponent, mantissa) = (i32::from(bits >> 10), f32::from(bits & 0x3ff));
            let back = if bits == 0 { 0.0 } else { (1.0 + mantissa / 1024.0) * 2f32.powi(exponent - 15) };
            assert_eq!(back, value);
        }
        for value in [0.1f32, 65_520.0, 1e-6, 2049.0] {
            assert_eq!(pack(&[value, 300.5]).0, wgpu::TextureFormat::R32Float, "{value}");
        }
    }
}
