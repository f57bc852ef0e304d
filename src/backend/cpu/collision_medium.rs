//! What collisions need of the medium.

use crate::scene::eye::LocalEye;
use crate::scene::field::{Field, V3};
use crate::scene::{Albedo, Scene};

/// What a photon needs of the medium at a collision.
pub struct Medium<'a> {
    /// The albedo by channel, where it is constant.
    pub constant: [f32; 3],
    /// The albedo's field, where it is not.
    pub field: Option<Field<'a>>,
    /// 1 / the largest density.
    per_density: f32,
    /// Spacing.
    pub h: V3,
    /// Voxels per length.
    pub inverse_h: V3,
    /// Where anisotropic media are recorded towards.
    pub eye: LocalEye,
}

impl<'a> Medium<'a> {
    /// That of a scene.
    #[inline(always)]
    pub fn new(scene: &'a Scene<'a>) -> Self {
        let medium = &scene.medium;
        let h = medium.volume.spacing();
        let (constant, field) = match medium.albedo {
            Albedo::Constant(a) => (a.rgb.map(|x| x as f32), None),
            Albedo::PerVoxel(values) => ([0.0; 3], Some(Field::new(values, &medium.volume))),
        };
        Medium {
            constant,
            field,
            per_density: 1.0 / medium.volume.max().max(1e-30),
            h: h.map(|c| c as f32),
            inverse_h: h.map(|c| (1.0 / c) as f32),
            eye: LocalEye::new(scene, &scene.camera),
        }
    }

    /// The albedo at a point; a per-voxel one by a read whose mean it is, which is unbiased as weights are linear in it.
    #[inline(always)]
    pub fn albedo<const C: usize>(&self, p: V3, word: u32) -> [f32; C] {
        match &self.field {
            None => std::array::from_fn(|c| self.constant[c]),
            Some(field) => [field.one_read(p, word); C],
        }
    }

    /// Absorption at a point of the given density, in multiples of [`crate::plan::Plan::largest_absorption`].
    #[inline(always)]
    pub fn relative_absorption(&self, p: V3, density: f32) -> f32 {
        let relative = density * self.per_density;
        match &self.field {
            None => relative,
            Some(field) => relative * (1.0 - field.at(p)),
        }
    }
}
