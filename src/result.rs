//! What a run found: means, standard errors, and where the energy went.

/// A share of the launched energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// Emitted past the box.
    Missed,
    /// Crossed the box without a collision.
    Unscattered,
    /// Absorbed.
    Absorbed,
    /// Cut off by the highest scattering order.
    Truncated,
    /// Lost less won in roulette; its mean is zero.
    Roulette,
    /// Left through the face x = 0 after a scattering, and so on.
    EscapedXLow,
    /// Left through the upper x face.
    EscapedXHigh,
    /// Left through the lower y face.
    EscapedYLow,
    /// Left through the upper y face.
    EscapedYHigh,
    /// Left through the lower z face.
    EscapedZLow,
    /// Left through the upper z face.
    EscapedZHigh,
}

/// The exits in the order -x +x -y +y -z +z.
pub const EXIT_FACES: [Share; 6] = [
    Share::EscapedXLow,
    Share::EscapedXHigh,
    Share::EscapedYLow,
    Share::EscapedYHigh,
    Share::EscapedZLow,
    Share::EscapedZHigh,
];

impl Share {
    /// Number of shares.
    pub const COUNT: usize = 11;
    /// All shares with their names in Python.
    pub const ALL: [(Share, &'static str); Share::COUNT] = [
        (Share::Missed, "missed"),
        (Share::Unscattered, "unscattered"),
        (Share::Absorbed, "absorbed"),
        (Share::Truncated, "truncated"),
        (Share::Roulette, "roulette"),
        (Share::EscapedXLow, "escaped_-x"),
        (Share::EscapedXHigh, "escaped_+x"),
        (Share::EscapedYLow, "escaped_-y"),
        (Share::EscapedYHigh, "escaped_+y"),
        (Share::EscapedZLow, "escaped_-z"),
        (Share::EscapedZHigh, "escaped_+z"),
    ];

    /// Its place in an array of all shares.
    #[inline(always)]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// The energy balance, by channel.
#[derive(Debug, Clone, Default)]
pub struct Energy {
    /// All that the lights emit [W].
    pub launched: [f64; 3],
    /// Each share as a fraction of it.
    pub fractions: [[f64; 3]; Share::COUNT],
    /// Standard error of the sum of all fractions, from the scatter of batches and of rays.
    pub error: [f64; 3],
    /// Standard error of what passes unscattered: where rays find it along with what collides, that of the sum tells nothing.
    pub unscattered_error: [f64; 3],
    /// That of what is absorbed.
    pub absorbed_error: [f64; 3],
    /// The sum of all fractions - 1, as it was found.
    pub imbalance: [f64; 3],
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stopped {
    /// All photons or paths were walked (or none were needed).
    #[default]
    Photons,
    /// The target error was reached.
    TargetError,
    /// Its time was over.
    TimeLimit,
    /// It was asked to.
    Progress,
    /// The GPU was lost.
    DeviceLost,
    /// Another error.
    Error,
}

/// An image in layers, row by row from the top, channels fastest.
#[derive(Debug, Clone, Default)]
pub struct Pixels {
    /// Light scattered once.
    pub order1: Vec<f32>,
    /// Light scattered more often.
    pub order2: Vec<f32>,
    /// Standard error of their sum.
    pub error: Vec<f32>,
}

/// What unscattered light adds to the outcome of a run, found without photons.
#[derive(Debug, Clone, Default)]
pub struct Order0 {
    /// Fluence and its standard error, where it is wanted.
    pub fluence: Option<(Vec<f32>, Vec<f32>)>,
    /// Radiance towards the eye and its standard error, where it is wanted.
    pub radiance: Option<(Vec<f32>, Vec<f32>)>,
    /// Absorbed power density and its standard error, where it is not the fluence times a coefficient.
    pub absorbed: Option<(Vec<f32>, Vec<f32>)>,
}

/// Arrays over voxels (x fastest, then channels), and what the run was like.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Fluence that photons left and its standard error.
    pub fluence: Option<(Vec<f32>, Vec<f32>)>,
    /// Radiance towards the eye of what photons left and its standard error.
    pub radiance: Option<(Vec<f32>, Vec<f32>)>,
    /// Absorbed power density and its standard error, where it is not the fluence times a coefficient.
    pub absorbed: Option<(Vec<f32>, Vec<f32>)>,
    /// In-scattered radiance J of incident orders >= 1.
    pub source: Option<Vec<f32>>,
    /// J of incident order 0 of lights without a deterministic order 1.
    pub source0: Option<Vec<f32>>,
    /// The image of a run of paths.
    pub pixels: Option<Pixels>,
    /// Independent estimates of `source` + `source0`, the replicate fastest.
    pub subvolumes: Option<Vec<f32>>,
    /// Replicates in `subvolumes`.
    pub replicates: usize,
    /// The voxels that no photon reached, if values of voxels are kept and there are such.
    pub unreached: Option<Vec<bool>>,
    /// J of one photon in a voxel that it crosses, by channel; 0 where J is exact.
    pub one_photon: [f64; 3],
    /// Column densities towards each light at the nodes of its grid, where used.
    pub columns: Vec<Option<Vec<f32>>>,
    /// Where the energy went.
    pub energy: Energy,
    /// Order 0, if the run's target needed it.
    pub order0: Option<Order0>,
    /// Photons or paths walked.
    pub photons: u64,
    /// Real collisions.
    pub collisions: u64,
    /// Finished batches; of a run of paths, view rays per pixel.
    pub batches: u64,
    /// Degrees of freedom of the standard errors of voxels.
    pub degrees_of_freedom: u64,
    /// Seconds of the stages: light grid, photons, estimate.
    pub seconds: [f64; 3],
    /// Why it ended.
    pub stopped: Stopped,
    /// What the user should know.
    pub warnings: Vec<String>,
}
