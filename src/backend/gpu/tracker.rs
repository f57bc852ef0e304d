//! Flights on the GPU: the shader files that a plan's need, and what these read.

use crate::backend::cpu::course::Course;
use crate::backend::cpu::track::{CellScore, Woodcock};
use crate::plan::{Plan, Score, Tracker};

/// Steps of a flight before it pauses.
const STEPS: u32 = 64;
/// Cells of majorants that a flight crosses before it pauses.
const CELLS: u32 = 32;

/// How flights are sampled.
pub struct Track {
    /// Shader files.
    pub files: Vec<&'static str>,
    /// Values of `override` constants.
    pub constants: Vec<(&'static str, f64)>,
    /// Majorants of cells, already times the largest extinction.
    pub majorants: Vec<f32>,
    /// How each cell scores.
    pub scores: Vec<u32>,
    /// Voxels per majorant cell and axis.
    pub block: i32,
    /// Cells along x, y, z.
    pub cells: [i32; 3],
    /// 1 / majorant, where there is one [length].
    pub free_path: f32,
    /// Loop iterations that a flight, or an event of one, takes at most before it pauses.
    pub iterations: u32,
}

impl Track {
    /// Null-collision flights, event by event.
    pub fn by_events(course: &Course) -> Self {
        let (block, cells, majorants) = course.majorants().unwrap_or((1.0, [1; 3], &[]));
        let files = vec![
            "flights",
            "weights_grey",
            if majorants.is_empty() { "flights_one" } else { "flights_cells" },
            if course.phase.is_isotropic() { "turn_isotropic" } else { "turn_phase" },
            if course.certain { "accept_all" } else { "accept_some" },
        ];
        Track {
            files,
            constants: vec![("CELLS", f64::from(CELLS))],
            majorants: majorants.to_vec(),
            scores: Vec::new(),
            block: block as i32,
            cells,
            free_path: course.free_path(),
            iterations: 1 + if majorants.is_empty() { 0 } else { CELLS },
        }
    }

    /// Flights of one photon or path after the other, by any tracker; `score` are the loop iterations of a score, 0 where flights leave nothing behind.
    pub fn new(plan: &Plan, score: u32) -> Self {
        let volume = &plan.scene.medium.volume;
        let scores = score > 0;
        let weights = if plan.chromatic { "weights_chromatic" } else { "weights_grey" };
        let mut track = Track {
            files: vec!["way", if scores { "score_deposit" } else { "score_nothing" }, weights],
            constants: vec![("STEPS", f64::from(STEPS)), ("SCORES", f64::from(u8::from(scores)))],
            majorants: Vec::new(),
            scores: Vec::new(),
            block: 1,
            cells: [1; 3],
            free_path: 0.0,
            iterations: STEPS * (1 + score) + 16,
        };
        // A flight may score in every voxel that it crosses, where it scores along its way.
        let line = if scores { volume.n().iter().sum::<usize>() as u32 * (1 + score) } else { 0 };
        match (plan.tracker, &plan.majorant) {
            (Tracker::Woodcock, Some(grid)) => {
                let tracker = Woodcock::<false>::new(plan, grid);
                track.files.push("tracker_woodcock");
                track.scores = tracker.score.iter().map(|&score| score as u32).collect();
                track.majorants = tracker.majorant;
                (track.block, track.cells) = (tracker.block, tracker.cells);
                track.iterations += if tracker.score.contains(&CellScore::Track) { line } else { 0 };
            }
            (Tracker::Analytic, _) => {
                track.files.push("tracker_analytic");
                let how = if scores { 1 + u32::from(plan.score == Score::Track) } else { 0 };
                track.constants.push(("SCORE", f64::from(how)));
                track.iterations += line;
            }
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
