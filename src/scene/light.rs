//! Lights. Each gives its power into the world, and says where its unscattered light comes from.

use super::environment::Map;
use super::{Spectrum, direction, finite};
use crate::error::Result;
use std::f64::consts::PI;
use std::sync::Arc;

/// The closed set of lights; positions in world coordinates.
#[derive(Debug, Clone, PartialEq)]
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
    /// Radiance from all directions [W/(area sr)]: the same from each, or that of a map.
    Environment {
        /// Radiance; with a map the largest of each channel.
        radiance: Spectrum,
        /// Radiance by direction, where it is not constant.
        map: Option<Arc<Map>>,
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
        Ok(Light::Environment { radiance: Spectrum::new(radiance, "EnvironmentLight: radiance")?, map: None })
    }

    /// The environment of a map, which is a constant one where all its texels are equal.
    pub fn environment_map(map: Map) -> Result<Self> {
        if let Some(texel) = map.constant() {
            return Self::environment(&texel.iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
        }
        let radiance = Spectrum::new(&map.max()[..map.channels()], "EnvironmentLight: radiance")?;
        Ok(Light::Environment { radiance, map: Some(Arc::new(map)) })
    }

    /// The name of its kind.
    pub fn name(&self) -> &'static str {
        match self {
            Light::Point { .. } => "PointLight",
            Light::Pencil { .. } => "PencilBeam",
            Light::Directional { .. } => "DirectionalLight",
            Light::Environment { map: None, .. } => "EnvironmentLight",
            Light::Environment { map: Some(_), .. } => "EnvironmentLight (map)",
        }
    }

    /// Intensity, power, irradiance or radiance.
    pub fn value(&self) -> &Spectrum {
        match self {
            Light::Point { intensity, .. } => intensity,
            Light::Pencil { power, .. } => power,
            Light::Directional { irradiance, .. } => irradiance,
            Light::Environment { radiance, .. } => radiance,
        }
    }

    /// What the light emits into a world that holds a box of this size [W], by channel: 4 pi times the intensity; the power;
    /// the irradiance times the box's projected area; the integral of radiance times projected area over all directions,
    /// which of a constant radiance is pi times the box's surface.
    pub fn launched(&self, size: [f64; 3]) -> [f64; 3] {
        let scale = match self {
            Light::Point { .. } => 4.0 * PI,
            Light::Pencil { .. } => 1.0,
            Light::Directional { direction, .. } => projected_area(*direction, size),
            Light::Environment { map: Some(map), .. } => return map.projected(size),
            Light::Environment { map: None, .. } => {
                2.0 * PI * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
            }
        };
        self.value().rgb.map(|value| value * scale)
    }
}

/// The area of a box's shadow along a unit direction.
pub fn projected_area(direction: [f64; 3], size: [f64; 3]) -> f64 {
    (0..3).map(|a| direction[a].abs() * size[(a + 1) % 3] * size[(a + 2) % 3]).sum()
}
