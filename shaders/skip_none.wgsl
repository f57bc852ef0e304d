// Nothing is known to be empty.

// Up to where a line is known to meet nothing from t on; t itself where that is nowhere.
fn clear_until(p: vec3<f32>, v: vec3<f32>, t: f32) -> f32 {
    return t;
}
