//! Lights on the GPU: where each comes from, and its light grid.

use super::device::Gpu;
use super::kernel::Binding;
use crate::backend::cpu::light::{Illumination, Source};
use crate::error::Result;
use bytemuck::{Pod, Zeroable};

/// `Light` of `shaders/light.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Light {
    pub place: [f32; 3],
    pub is_point: u32,
    pub value: [f32; 3],
    pub rays: u32,
    pub first: u32,
    pub has_nodes: u32,
    pub check: f32,
    pub spare: u32,
}

/// The lights of a kernel.
#[derive(Debug)]
pub struct Lights {
    list: wgpu::Buffer,
    nodes: wgpu::TextureView,
    /// How many there are.
    pub count: u32,
}

impl Lights {
    /// Uploads lights, each with the chance of a correcting ray (1 where that is no matter). Light grids that do not fit on
    /// top of each other are left out: rays then find the depth.
    pub fn new<'a>(gpu: &Gpu, views: impl Iterator<Item = (&'a Illumination<'a>, f32)>) -> Result<Self> {
        let (mut list, mut nodes) = (Vec::new(), Vec::new());
        let (mut n, mut layers) = ([1; 3], 0);
        for (view, check) in views {
            let (place, is_point) = match view.source {
                Source::Point(p) => (p, 1),
                Source::Directional(d) => (d, 0),
            };
            let grid = view.grid().filter(|_| layers + view.layers()[2] <= gpu.description.extent as usize);
            let first = layers as u32;
            if let Some(grid) = grid {
                nodes.extend_from_slice(grid);
                layers += view.layers()[2];
                n = view.layers();
            }
            list.push(Light {
                place,
                is_point,
                value: view.value,
                rays: u32::from(view.nodes().is_none()),
                first,
                has_nodes: u32::from(grid.is_some()),
                check,
                spare: 0,
            });
        }
        let count = list.len() as u32;
        list.resize(list.len().max(1), Light::default());
        nodes.resize(nodes.len().max(1), 0.0f32);
        let n = [n[0], n[1], layers.max(1)];
        let nodes = gpu.texture(n, wgpu::TextureFormat::R32Float, bytemuck::cast_slice(&nodes))?;
        Ok(Lights { list: gpu.buffer(&list)?, nodes, count })
    }

    /// For kernels.
    pub fn bindings(&self) -> [(&'static str, Binding<'_>); 2] {
        [("lights", Binding::Buffer(&self.list)), ("nodes", Binding::Texture(&self.nodes))]
    }
}
