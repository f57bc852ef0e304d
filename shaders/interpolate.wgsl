// Values per voxel, linear between voxel centres; beyond the outermost centres the line through the last two goes on.

// Up to four values at a point.
fn interpolate(values: texture_3d<f32>, p: vec3<f32>) -> vec4<f32> {
    let q = p - 0.5;
    let a = max(min(floors(q), scene.n - 2), vec3(0));
    let b = min(a + 1, scene.n - 1);
    let u = q - vec3<f32>(a);
    let w = 1.0 - u;
    var sum = w.z * w.y * w.x * textureLoad(values, a, 0);
    sum += w.z * w.y * u.x * textureLoad(values, vec3(b.x, a.y, a.z), 0);
    sum += w.z * u.y * w.x * textureLoad(values, vec3(a.x, b.y, a.z), 0);
    sum += w.z * u.y * u.x * textureLoad(values, vec3(b.x, b.y, a.z), 0);
    sum += u.z * w.y * w.x * textureLoad(values, vec3(a.x, a.y, b.z), 0);
    sum += u.z * w.y * u.x * textureLoad(values, vec3(b.x, a.y, b.z), 0);
    sum += u.z * u.y * w.x * textureLoad(values, vec3(a.x, b.y, b.z), 0);
    sum += u.z * u.y * u.x * textureLoad(values, b, 0);
    return sum;
}
