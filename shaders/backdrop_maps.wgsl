// The environment behind the volume is one of maps.

// The mean radiance over a ray's share of a pixel, which has the given corner.
fn backdrop(corner: vec2<f32>) -> vec3<f32> {
    var sum = job.sky;
    let count = job.finer * job.finer;
    let weight = 1.0 / f32(count);
    for (var i = 0u; i < count; i++) {
        let part = (vec2(f32(i % job.finer), f32(i / job.finer)) + 0.5) / f32(job.finer * job.samples);
        let d = normalize(view_ahead(corner + part));
        for (var map = 0u; map < job.maps; map++) {
            sum += weight * map_radiance(map, d);
        }
    }
    return sum;
}
