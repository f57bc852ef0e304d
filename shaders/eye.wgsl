// The unit vector from a point towards an eye: a point in voxels (w = 1), or a direction (w = 0).
fn to_eye(eye: vec4<f32>, p: vec3<f32>, h: vec3<f32>) -> vec3<f32> {
    if eye.w == 0.0 {
        return eye.xyz;
    }
    let r = (eye.xyz - p) * h;
    return r / max(sqrt(r.x * r.x + r.y * r.y + r.z * r.z), 1e-30);
}
