//! Column densities towards a light at twice as many nodes per axis as voxels, where there is anything to be lit: for
//! pictures, whose view rays take many more samples than that, so that not each of them needs a light ray.

use super::Illumination;
use crate::scene::field::{BLOCK, V3};
use rayon::prelude::*;

/// Nodes per voxel and axis.
pub const NODES: usize = 2;
/// Cells between nodes along each axis of a block of voxels, and the nodes of these.
const CELLS: usize = NODES * BLOCK;
const SIDE: usize = CELLS + 1;
/// Most nodes of a light: 128 MiB.
const MOST: usize = 1 << 25;
/// A block without nodes.
const NONE: u32 = u32::MAX;

/// Nodes in blocks of voxels, those that are not empty; each block has its own on its faces.
#[derive(Debug)]
pub struct Fine {
    /// Blocks along x, y, z.
    blocks: [usize; 3],
    /// Which nodes belong to a block, x fastest.
    places: Vec<u32>,
    nodes: Vec<f32>,
}

impl Fine {
    /// Whether a picture of so many samples, evenly over the volume, would read each node once or more.
    pub fn pays(light: &Illumination, samples: f64) -> bool {
        let blocks = blocks(light);
        let count = blocks.iter().product::<usize>();
        let occupied = (0..count).filter(|&at| occupied(light, blocks, at)).count();
        let nodes = occupied * CELLS.pow(3);
        nodes <= MOST && samples * occupied as f64 >= nodes as f64 * count as f64
    }

    /// Finds the columns at all nodes by light rays; incomplete if it was stopped.
    ///
    /// Between nodes h apart a linear interpolation lies above a smooth function f by h^2/12 f'' on average, along each
    /// axis: the nodes are lowered by a twelfth of their second differences, so that the errors along a view ray cancel.
    pub fn new(light: &Illumination, stop: &(impl Fn() -> bool + Sync)) -> Self {
        let blocks = blocks(light);
        let mut places = vec![NONE; blocks.iter().product()];
        let mut corners = Vec::new();
        for (at, place) in places.iter_mut().enumerate().filter(|(at, _)| occupied(light, blocks, *at)) {
            *place = corners.len() as u32;
            corners.push(corner(blocks, at));
        }
        // Nodes that are not read have no number.
        let mut exact = vec![f32::NAN; corners.len() * SIDE.pow(3)];
        exact.par_chunks_mut(SIDE.pow(3)).zip(&corners).for_each(|(nodes, corner)| {
            if stop() {
                return;
            }
            for (at, node) in
                nodes.iter_mut().enumerate().zip(wanted(light, *corner)).filter_map(|(n, w)| w.then_some(n))
            {
                let place = place_of(at);
                let p: V3 = std::array::from_fn(|a| corner[a] as f32 + place[a] as f32 / NODES as f32);
                *node = light.ray(p, &light.incident(p));
            }
        });
        let mut fine = Fine { blocks, places, nodes: exact };
        let mut lowered = vec![0.0f32; fine.nodes.len()];
        lowered.par_chunks_mut(SIDE.pow(3)).enumerate().for_each(|(brick, nodes)| {
            for (at, node) in nodes.iter_mut().enumerate() {
                let here = fine.nodes[brick * SIDE.pow(3) + at];
                if here.is_finite() {
                    let bend: f32 = (0..3).map(|axis| fine.bend(here, brick, corners[brick], at, axis)).sum();
                    *node = here - bend / 12.0;
                }
            }
        });
        fine.nodes = lowered;
        fine
    }

    /// The second difference along an axis at a node; 0 where a neighbour is not known.
    fn bend(&self, here: f32, brick: usize, corner: [usize; 3], at: usize, axis: usize) -> f32 {
        let place = place_of(at);
        let stride = [1, SIDE, SIDE * SIDE][axis];
        let beside = |upper: bool| match (upper, place[axis]) {
            (false, 0) if corner[axis] == 0 => f32::NAN,
            (false, 0) | (true, CELLS) => {
                // In the next block the node's own place is at the other end.
                let mut next = corner.map(|c| c / BLOCK);
                next[axis] = if upper { next[axis] + 1 } else { next[axis] - 1 };
                if next[axis] >= self.blocks[axis] {
                    return f32::NAN;
                }
                match self.places[(next[2] * self.blocks[1] + next[1]) * self.blocks[0] + next[0]] {
                    NONE => f32::NAN,
                    place => {
                        let own = place as usize * SIDE.pow(3) + at;
                        self.nodes[if upper { own - (CELLS - 1) * stride } else { own + (CELLS - 1) * stride }]
                    }
                }
            }
            (upper, _) => {
                let own = brick * SIDE.pow(3) + at;
                self.nodes[if upper { own + stride } else { own - stride }]
            }
        };
        let bend = beside(false) - 2.0 * here + beside(true);
        if bend.is_finite() { bend } else { 0.0 }
    }

    /// The column density at a point, interpolated.
    #[inline(always)]
    pub fn at(&self, p: V3) -> f32 {
        let block: [usize; 3] = std::array::from_fn(|a| ((p[a].max(0.0) as usize) / BLOCK).min(self.blocks[a] - 1));
        let place = self.places[(block[2] * self.blocks[1] + block[1]) * self.blocks[0] + block[0]];
        if place == NONE {
            return 0.0;
        }
        let q: V3 = std::array::from_fn(|a| ((p[a] - (BLOCK * block[a]) as f32) * NODES as f32).max(0.0));
        let cell = q.map(|c| (c as usize).min(CELLS - 1));
        let u: V3 = std::array::from_fn(|a| q[a] - cell[a] as f32);
        let nodes = &self.nodes[place as usize * SIDE * SIDE * SIDE..];
        let x = |at: usize| nodes[at] + u[0] * (nodes[at + 1] - nodes[at]);
        let y = |at: usize| x(at) + u[1] * (x(at + SIDE) - x(at));
        let base = (cell[2] * SIDE + cell[1]) * SIDE + cell[0];
        let low = y(base);
        (low + u[2] * (y(base + SIDE * SIDE) - low)).max(0.0)
    }
}

/// Blocks of voxels along x, y, z.
fn blocks(light: &Illumination) -> [usize; 3] {
    light.field.n().map(|m| (m as usize).div_ceil(BLOCK))
}

/// The first voxel of a block.
fn corner(blocks: [usize; 3], at: usize) -> [usize; 3] {
    [at % blocks[0], at / blocks[0] % blocks[1], at / (blocks[0] * blocks[1])].map(|c| c * BLOCK)
}

fn occupied(light: &Illumination, blocks: [usize; 3], at: usize) -> bool {
    light.field.occupied(corner(blocks, at))
}

/// A node's place in its block.
fn place_of(at: usize) -> [usize; 3] {
    [at % SIDE, at / SIDE % SIDE, at / (SIDE * SIDE)]
}

/// Which nodes of a block are around cells that hold any density, or next to such nodes.
fn wanted(light: &Illumination, corner: [usize; 3]) -> Vec<bool> {
    let field = &light.field;
    let mut wanted = vec![false; SIDE.pow(3)];
    for at in 0..CELLS.pow(3) {
        let cell = [at % CELLS, at / CELLS % CELLS, at / (CELLS * CELLS)];
        let whole: [usize; 3] = std::array::from_fn(|a| NODES * corner[a] + cell[a]);
        if (0..3).any(|a| whole[a] >= NODES * field.n()[a] as usize) {
            continue;
        }
        let empty = if field.linear() {
            field.corners(whole.map(|c| ((c + 1) / NODES) as i32 - 1)).is_zero()
        } else {
            field.voxel(whole.map(|c| (c / NODES) as i32)) == 0.0
        };
        if !empty {
            for (y, z) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                wanted[((cell[2] + z) * SIDE + cell[1] + y) * SIDE + cell[0]..][..2].fill(true);
            }
        }
    }
    let sure = wanted.clone();
    for at in (0..sure.len()).filter(|&at| sure[at]) {
        for (place, stride) in place_of(at).into_iter().zip([1, SIDE, SIDE * SIDE]) {
            if place > 0 {
                wanted[at - stride] = true;
            }
            if place < CELLS {
                wanted[at + stride] = true;
            }
        }
    }
    // Beyond the box there is nothing.
    for (at, wanted) in wanted.iter_mut().enumerate() {
        let place = place_of(at);
        *wanted &= (0..3).all(|a| NODES * corner[a] + place[a] <= NODES * field.n()[a] as usize);
    }
    wanted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Column;
    use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

    const N: [usize; 3] = [22, 17, 26];

    /// The root mean square error of the transmittance at places that hold density, and its mean.
    fn error(linear: bool, light: &Light) -> (f64, f64) {
        let density: Vec<f32> = (0..N[0] * N[1] * N[2])
            .map(|at| {
                let p = [at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32);
                ((0.7 * p[0]).sin() * (0.5 * p[1] + 1.0).cos() + (0.6 * p[2]).sin()).max(0.0)
            })
            .collect();
        let volume = Volume::new(&density, N, [1.0, 1.5, 0.75], [0.0; 3], linear).expect("valid");
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        let phase = crate::physics::Phase::Isotropic;
        let medium = Medium::new(volume, grey(0.2), Albedo::Constant(grey(0.9)), phase).expect("valid");
        let camera = Camera::perspective([90.0; 3], [9.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
        let scene = Scene::new(medium, vec![light.clone()], camera);
        let rays = Illumination::new(&scene, None, light, Column::Rays, None).expect("has a direction");
        let fine = Fine::new(&rays, &|| false);
        let (mut square, mut sum, mut count) = (0.0, 0.0, 0.0);
        for i in 0..20_000u32 {
            let r = |k: u32| f64::from(i.wrapping_mul(747_796_405).wrapping_add(k.wrapping_mul(2_891_336_453)) >> 8);
            let p: V3 = std::array::from_fn(|a| (N[a] as f64 * r(a as u32 + 1) / 16_777_216.0) as f32);
            if rays.density(p) > 0.0 {
                let [exact, between] = [rays.ray(p, &rays.incident(p)), fine.at(p)];
                let error = f64::from((-0.2 * between).exp() - (-0.2 * exact).exp());
                (square, sum, count) = (square + error * error, sum + error, count + 1.0);
            }
        }
        ((square / count).sqrt(), sum / count)
    }

    #[test]
    fn columns_between_fine_nodes_are_those_of_light_rays_on_average() {
        for light in [
            Light::point([40.0, -30.0, 60.0], &[1.0]).expect("valid"),
            Light::directional([-0.3, 1.0, 0.25], &[1.0]).expect("valid"),
        ] {
            for linear in [true, false] {
                let (rms, mean) = error(linear, &light);
                // What the plan allows of the light grid's interpolation is .5 %. At the faces of constant voxels the column
                // has kinks, which no second difference sees.
                let most = if linear { (5e-3, 1e-3) } else { (1e-2, 3e-3) };
                assert!(rms < most.0 && mean.abs() < most.1, "{light:?}, linear {linear}: {rms}, mean {mean}");
            }
        }
    }
}
