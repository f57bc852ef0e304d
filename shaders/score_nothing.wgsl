// Flights leave nothing behind.

fn score(voxel: u32, p: vec3<f32>, value: Spectrum, xi: f32) {}

fn scores_absorption() -> bool {
    return false;
}

fn score_absorbed(voxel: u32, p: vec3<f32>, density: f32, value: Spectrum, xi: f32) {}

fn score_track(p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, value: Spectrum, word: u32) {}
