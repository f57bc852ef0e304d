//! Flights of one path after the other on the GPU: the shader files of a tracker, and what they read.

use crate::backend::cpu::track::Woodcock;
use crate::plan::{Plan, Tracker};

/// Steps of a flight before it pauses.
const STEPS: u32 = 64;

/// A tracker whose flights leave nothing behind.
pub struct Track {
    /// Shader files.
    pub files: Vec<&'static str>,
    /// Values of `override` constants.
    pub constants: Vec<(&'static str, f64)>,
    /// Majorants of cells, already times the largest extinction.
    pub majorants: Vec<f32>,
    /// Voxels per majorant cell and axis, and cells along x, y, z.
    pub block: i32,
    /// Cells along x, y, z.
    pub cells: [i32; 3],
    /// Loop iterations that a flight takes at most before it pauses.
    pub iterations: u32,
}

impl Track {
    /// That of a plan.
    pub fn new(plan: &Plan) -> Self {
        let volume = &plan.scene.medium.volume;
        let weights = if plan.chromatic { "weights_chromatic" } else { "weights_grey" };
        let mut track = Track {
            files: vec!["way", "score_nothing", weights],
            constants: vec![("STEPS", f64::from(STEPS)), ("SCORE", 0.0), ("SCORES", 0.0), ("TENTATIVES", 1.0)],
            majorants: Vec::new(),
            block: 1,
            cells: [1; 3],
            iterations: STEPS + 16,
        };
        match (plan.tracker, &plan.majorant) {
            (Tracker::Woodcock, Some(grid)) => {
                let tracker = Woodcock::<false>::new(plan, grid);
                track.files.push("tracker_woodcock");
                track.majorants = tracker.majorant;
                (track.block, track.cells) = (tracker.block, tracker.cells);
            }
            (Tracker::Analytic, _) => track.files.push("tracker_analytic"),
            _ => {
                let linear = volume.linear() && !volume.is_constant();
                track.files.push("tracker_march");
                track.files.push(if volume.is_constant() { "march_constant" } else { "march_voxels" });
                track.files.push(if linear { "march_linear" } else { "march_nearest" });
                track.constants.push(("PARTS", if volume.linear() { 2.0 } else { 1.0 }));
                track.iterations += 24;
            }
        }
        track
    }
}
