//! Lines through the voxel grid: where they leave it, and which cells they cross.

/// A point or vector along x, y, z.
pub type V3 = [f32; 3];

/// `p + t v`.
#[inline(always)]
pub fn along(p: V3, v: V3, t: f32) -> V3 {
    [p[0] + v[0] * t, p[1] + v[1] * t, p[2] + v[2] * t]
}

/// Where a line from within the box [0, n] leaves it: the axis of the face, and the parameter.
#[inline(always)]
pub fn leave(p: V3, v: V3, n: [i32; 3]) -> (usize, f32) {
    let (mut axis, mut exit) = (0, f32::INFINITY);
    for a in 0..3 {
        let edge = if v[a] > 0.0 { n[a] as f32 } else { 0.0 };
        let t = if v[a] != 0.0 { ((edge - p[a]) / v[a]).max(0.0) } else { f32::INFINITY };
        if t < exit {
            (axis, exit) = (a, t);
        }
    }
    (axis, exit)
}

/// The parameter at which a line from within the ball in a unit cube leaves it.
#[inline(always)]
pub fn leave_ball(p: V3, v: V3) -> f32 {
    let r = p.map(|c| c - 0.5);
    let dot = |a: V3, b: V3| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (a, b, c) = (dot(v, v), dot(r, v), dot(r, r) - 0.25);
    let root = (b * b - a * c).max(0.0).sqrt();
    // The form that does not cancel.
    if b > 0.0 { (-c / (b + root)).max(0.0) } else { ((root - b) / a).max(0.0) }
}

/// The largest integer not above `x` (within i32), without a library call.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    let cut = x as i32;
    cut - i32::from((cut as f32) > x)
}

/// A walk through the unit cells that a line crosses (Amanatides and Woo 1987). Progress is made in integers, so that
/// rounding can neither stop it nor lead it off the grid.
#[derive(Debug, Clone, Copy)]
pub struct Dda {
    /// The current cell.
    pub cell: [i32; 3],
    low: [i32; 3],
    high: [i32; 3],
    step: [i32; 3],
    next: V3,
    delta: V3,
}

impl Dda {
    /// Starts in the cell of `q`, moved onto the grid of cells `low..high` if rounding put it outside.
    #[inline(always)]
    pub fn new(q: V3, v: V3, low: [i32; 3], high: [i32; 3]) -> Self {
        let mut dda =
            Dda { cell: [0; 3], low, high, step: [0; 3], next: [f32::INFINITY; 3], delta: [f32::INFINITY; 3] };
        for a in 0..3 {
            let cell = floor(q[a]).clamp(low[a], high[a] - 1);
            dda.cell[a] = cell;
            if v[a] != 0.0 {
                let inverse = 1.0 / v[a];
                dda.step[a] = if v[a] > 0.0 { 1 } else { -1 };
                let edge = if v[a] > 0.0 { cell + 1 } else { cell };
                dda.next[a] = ((edge as f32 - q[a]) * inverse).max(0.0);
                dda.delta[a] = inverse.abs();
            }
        }
        dda
    }

    /// The axis whose face is crossed next, and the parameter there.
    #[inline(always)]
    pub fn exit(&self) -> (usize, f32) {
        let [x, y, z] = self.next;
        if x < y {
            if x < z { (0, x) } else { (2, z) }
        } else if y < z {
            (1, y)
        } else {
            (2, z)
        }
    }

    /// Steps over the face; false if that leaves the grid.
    #[inline(always)]
    pub fn advance(&mut self, axis: usize) -> bool {
        self.cell[axis] += self.step[axis];
        self.next[axis] += self.delta[axis];
        self.cell[axis] >= self.low[axis] && self.cell[axis] < self.high[axis]
    }

    /// The number of the face crossed by the last step along `axis`: -x +x -y +y -z +z.
    #[inline(always)]
    pub fn face(&self, axis: usize) -> usize {
        2 * axis + usize::from(self.step[axis] > 0)
    }
}
