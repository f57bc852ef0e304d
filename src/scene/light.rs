//! Lights. Each gives its power into the world, and says where its unscattered light comes from.

use super::{Spectrum, direction, finite};
use crate::error::Result;

/// The closed set of lights; positions in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// An isotropic point of the given intensity [W/sr].
    Point {
        /// Where it stands, inside or outside the box.
        position: [f64; 3],
        /// Intensity [W/sr].
        intensity: Spectrum,
    },
    /// An infinitely thin beam [W].
    Pencil {
        /// A point on the beam, from which it starts.
        position: [f64; 3],
        /// Unit vector along which it travels.
        direction: [f64; 3],
        /// Power [W].
        power: Spectrum,
    },
    /// Parallel light from infinity.
    Directional {
        /// Unit vector along which it travels.
        direction: [f64; 3],
        /// Irradiance on a plane normal to it [W/area].
        irradiance: Spectrum,
    },
    /// The same radiance from all directions [W/(area sr)].
    Environment {
        /// Radiance.
        radiance: Spectrum,
    },
}

impl Light {
    /// A point light.
    pub fn point(position: [f64; 3], intensity: &[f64]) -> Result<Self> {
        Ok(Light::Point {
            position: finite(position, "PointLight: position")?,
            intensity: Spectrum::new(intensity, "PointLight: intensity")?,
        })
    }

    /// A pencil beam.
    pub fn pencil(position: [f64; 3], towards: [f64; 3], power: &[f64]) -> Result<Self> {
        Ok(Light::Pencil {
            position: finite(position, "PencilBeam: position")?,
            direction: direction(towards, "PencilBeam: direction")?,
            power: Spectrum::new(power, "PencilBeam: power")?,
        })
    }

    /// A directional light.
    pub fn directional(towards: [f64; 3], irradiance: &[f64]) -> Result<Self> {
        Ok(Light::Directional {
            direction: direction(towards, "DirectionalLight: direction")?,
            irradiance: Spectrum::new(irradiance, "DirectionalLight: irradiance")?,
        })
    }

    /// A constant environment.
    pub fn environment(radiance: &[f64]) -> Result<Self> {
        Ok(Light::Environment { radiance: Spectrum::new(radiance, "EnvironmentLight: radiance")? })
    }

    /// The name of its kind in Python.
    pub fn name(&self) -> &'static str {
        match self {
            Light::Point { .. } => "PointLight",
            Light::Pencil { .. } => "PencilBeam",
            Light::Directional { .. } => "DirectionalLight",
            Light::Environment { .. } => "EnvironmentLight",
        }
    }

    /// Intensity, power, irradiance or radiance.
    pub fn value(&self) -> &Spectrum {
        match self {
            Light::Point { intensity, .. } => intensity,
            Light::Pencil { power, .. } => power,
            Light::Directional { irradiance, .. } => irradiance,
            Light::Environment { radiance } => radiance,
        }
    }

    /// What the light emits, per unit of its value, into a world that holds a box of this size [W]: 4 pi; 1; the box's
    /// projected area; pi times the box's surface.
    pub fn launched(&self, size: [f64; 3]) -> f64 {
        match self {
            Light::Point { .. } => 4.0 * std::f64::consts::PI,
            Light::Pencil { .. } => 1.0,
            Light::Directional { direction, .. } => projected_area(*direction, size),
            Light::Environment { .. } => {
                2.0 * std::f64::consts::PI * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
            }
        }
    }
}

/// The area of a box's shadow along a unit direction.
pub fn projected_area(direction: [f64; 3], size: [f64; 3]) -> f64 {
    (0..3).map(|a| direction[a].abs() * size[(a + 1) % 3] * size[(a + 2) % 3]).sum()
}
