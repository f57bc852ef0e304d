//! Where the rays of a sweep stand in each plane.

/// Rays per voxel and axis in the plane where they stand furthest apart.
const DENSITY: f64 = 1.5;
/// Rays beyond the outermost nodes, which interpolation reads.
const MARGIN: f64 = 3.0;

/// The rays' places along one axis across the light's: ray `i` crosses the plane `w` at a + a1 w + (b + b1 w) i.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    /// Voxels.
    pub n: usize,
    /// Rays.
    pub count: usize,
    a: f64,
    a1: f64,
    b: f64,
    b1: f64,
    /// The side of the box that light comes in by: -1, 1, or 0 for neither.
    lit: f64,
}

impl Lattice {
    /// Rays of parallel light, for planes up to `depth`.
    pub fn parallel(n: usize, slope: f64, depth: f64) -> Self {
        // Along an axis the rays run through the centres.
        let step = if slope.abs() < 1e-6 { 1.0 } else { 1.0 / DENSITY };
        let (ends, margin) = ([-0.5 * slope, depth * slope], MARGIN.ceil() * step);
        let a = -0.5 - margin - ends[0].max(ends[1]);
        let last = n as f64 + 0.5 + margin - ends[0].min(ends[1]);
        let lit = if slope == 0.0 { 0.0 } else { -slope.signum() };
        Lattice { n, count: ((last - a) / step).ceil() as usize + 1, a, a1: slope, b: step, b1: 0.0, lit }
    }

    /// Rays from the point (light, start), for planes from `first` to `depth`, up to the slope `limit`.
    pub fn from_point(n: usize, light: f64, start: f64, (first, depth): (f64, f64), limit: f64) -> Option<Self> {
        let (low, high) = (-0.5 - light, n as f64 + 0.5 - light);
        let [near, far] = [first, depth].map(|w| (w - start).max(1e-3));
        let step = 1.0 / (DENSITY * far);
        let slopes = [(low / near).min(low / far).max(-limit), (high / near).max(high / far).min(limit)];
        if slopes[0] > slopes[1] {
            return None;
        }
        let s0 = slopes[0] - MARGIN * step;
        let count = ((slopes[1] - slopes[0]) / step + 2.0 * MARGIN).ceil() as usize + 1;
        let lit = if light < 0.0 { -1.0 } else { f64::from(u8::from(light > n as f64)) };
        Some(Lattice { n, count, a: light - start * s0, a1: s0, b: -start * step, b1: step, lit })
    }

    pub fn at(&self, i: usize, w: f64) -> f64 {
        self.a + self.a1 * w + (self.b + self.b1 * w) * i as f64
    }

    /// The number, with its fraction, of the ray at `x`.
    pub fn index(&self, x: f64, w: f64) -> f64 {
        (x - self.a - self.a1 * w) / (self.b + self.b1 * w)
    }

    /// The rays within the box and near it from `w0` to `w1`.
    pub fn active(&self, w0: f64, w1: f64) -> (usize, usize) {
        let low = self.index(-0.5, w0).min(self.index(-0.5, w1)) - MARGIN;
        let high = self.index(self.n as f64 + 0.5, w0).max(self.index(self.n as f64 + 0.5, w1)) + MARGIN + 1.0;
        let clip = |i: f64| i.clamp(0.0, self.count as f64) as usize;
        (clip(low), clip(high))
    }

    /// The way along the light's axis that each ray has yet to go to come in by the lit side; 0 for those within.
    pub fn way_in(&self, w: f64) -> Vec<f32> {
        let way = |i: usize| {
            let (x, slope) = (self.at(i, w), self.a1 + self.b1 * i as f64);
            let outside = if self.lit < 0.0 { -x } else { x - self.n as f64 };
            match (self.lit != 0.0 && outside > 0.0, -self.lit * slope) {
                (false, _) => 0.0,
                (true, inward) if inward > 0.0 => (outside / inward) as f32,
                _ => f32::INFINITY,
            }
        };
        (0..self.count).map(way).collect()
    }

    /// For each ray the two voxels to interpolate between in the plane `w`: the lower one, and the weight of the upper; or
    /// the voxel that it is in.
    pub fn cells(&self, w: f64, linear: bool) -> (Vec<u32>, Vec<f32>) {
        let cell = |i: usize| {
            let shift = if linear { 0.5 } else { 0.0 };
            let q = (self.at(i, w) - shift).clamp(0.0, self.n as f64 - 1.0);
            (q as u32, if linear { (q - q.floor()) as f32 } else { 0.0 })
        };
        (0..self.count).map(cell).unzip()
    }

    /// For each node the first of the four rays to interpolate between in the plane `w`, and their weights; `None` for
    /// nodes that belong to another sector.
    pub fn taps(&self, w: f64, mine: impl Fn(f64) -> bool) -> Vec<Option<Tap>> {
        let tap = |node: usize| {
            let x = node as f64 - 0.5;
            mine(x).then(|| {
                let at = self.index(x, w).clamp(1.0, self.count as f64 - 3.0 - 1e-9);
                let t = at - at.floor();
                // Catmull and Rom: cubic, through the rays' values.
                let weights = [
                    t * (-0.5 + t * (1.0 - 0.5 * t)),
                    1.0 + t * t * (-2.5 + 1.5 * t),
                    t * (0.5 + t * (2.0 - 1.5 * t)),
                    t * t * (-0.5 + 0.5 * t),
                ];
                (at as usize - 1, weights.map(|w| w as f32))
            })
        };
        (0..self.n + 2).map(tap).collect()
    }
}

/// The first of four rays, and their weights.
pub type Tap = (usize, [f32; 4]);
