//! Why a plan is as it is: its decisions, each with its reason and number.

use super::{Column, Connection, Direct, Emission, LightPlan, Method, REPLICATES, Rays, Settings};
use crate::scene::medium::Emission as Glow;
use crate::scene::{Camera, Light};

/// A decision with its reason, as EXPLAIN prints them.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// What was decided.
    pub name: &'static str,
    /// What was chosen.
    pub choice: String,
    /// Why, with its number.
    pub reason: String,
}

/// The decisions as they are made.
#[derive(Default)]
pub(super) struct Explain {
    pub decisions: Vec<Decision>,
}

impl Explain {
    pub fn push(&mut self, name: &'static str, choice: String, reason: String) {
        self.decisions.push(Decision { name, choice, reason });
    }

    pub fn device(&mut self, settings: &Settings) {
        let choice = settings.adapter.as_ref().map_or("cpu".into(), |adapter| format!("gpu: {}", adapter.name));
        self.push("backend", choice, settings.chosen.into());
    }

    pub fn camera(&mut self, camera: &Camera) {
        if let Some(axis) = camera.up_stand_in() {
            let reason = "the view is along the up that was given; this is the axis that it is least along";
            self.push("camera", format!("up is +{axis}"), reason.into());
        }
    }

    pub fn scores(&mut self, least_depth: f64) {
        self.push(
            "scores",
            format!("at collisions, the majorant being {least_depth:.3} per voxel at least"),
            "the medium is homogeneous: steps of a photon do not grow with the number of voxels".into(),
        );
    }

    pub fn emission(&mut self, glow: &Glow, emits: bool, method: Method) {
        let (choice, reason) = if emits && method == Method::Path {
            ("met by paths between their vertices", "seen directly it is integrated along view rays")
        } else if emits {
            ("photons start in the medium, drawn by what it emits", "seen directly it is integrated along view rays")
        } else {
            ("no photons", "it is zero everywhere")
        };
        let colour = if glow.channels() > 1 { "RGB" } else { "grey" };
        self.push("emission", format!("{colour}: {choice}"), reason.into());
    }

    pub fn connection(&mut self, light: &Light, how: &Connection) {
        let (choice, reason) = match how {
            Connection::Corrected(chance) => (
                "connected by the light grid".into(),
                format!("put right by a light ray with the chance {chance:.3}, which keeps it unbiased"),
            ),
            Connection::Ray => ("connected by light rays".to_string(), "exact".into()),
            Connection::Near => (
                "in the medium or next to it".into(),
                "points are drawn by their distance from it, so that the variance is finite".into(),
            ),
            Connection::Environment => match light {
                Light::Environment { map: Some(_), .. } => (
                    "met by what leaves the volume, and drawn from".into(),
                    "phase function and map, weighed by the balance heuristic".into(),
                ),
                _ => ("met by what leaves the volume".into(), "it is the same in all directions".into()),
            },
        };
        self.push("light", format!("{}: {choice}", light.name()), reason);
    }

    pub fn light(&mut self, light: &Light, plan: &LightPlan, depth: f64) {
        let name = light.name();
        let direct = match plan.direct {
            Direct::Rays(Rays { sparse: true, .. }) => format!(
                "order 0 by {REPLICATES} light rays for each two or four cells of a plane, which find what it lacks of the \
                 vacuum's"
            ),
            Direct::Rays(Rays { lattice, .. }) => format!(
                "order 0 by {REPLICATES} x {} light rays for each cell of a plane, each exact along its way",
                lattice.points()
            ),
            Direct::Beam => "order 0 exact along the beam".into(),
            Direct::Sampled => "order 0 by photons".into(),
        };
        let column = match (plan.direct, plan.column) {
            (Direct::Beam, _) | (Direct::Sampled, Column::Grid) => String::new(),
            (_, Column::Grid) => ", depth towards it from the light grid".into(),
            (_, Column::Rays) => ", depth towards it by light rays".into(),
        };
        let emission = match plan.emission {
            Emission::Nothing => "no photons",
            Emission::AtLight => "photons start at the light",
            Emission::FirstCollision => "photons start at their first collision",
        };
        self.push(
            "light",
            format!("{name}: {emission}; {direct}{column}"),
            format!(
                "a voxel's optical depth is at most {depth:.3}{}",
                match light {
                    Light::Point { .. } | Light::Directional { .. } if plan.interpolation_error > 0.0 => format!(
                        ", interpolating the light grid would err by {:.2} % in the image{}",
                        100.0 * plan.interpolation_error,
                        if plan.fine() {
                            let error = 100.0 * plan.fine_error;
                            format!(", between two nodes per voxel, as large pictures do, by {error:.2} %")
                        } else {
                            String::new()
                        }
                    ),
                    _ => String::new(),
                }
            ),
        );
    }
}
