// The number of a face: -x +x -y +y -z +z.
fn face_of(axis: i32, v: vec3<f32>) -> u32 {
    return 2u * u32(axis) + u32(v[axis] > 0.0);
}
