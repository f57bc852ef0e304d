// The sky is the same in all directions.

const HAS_MAPS = false;

// What maps add at a vertex.
fn connect_maps(path: ptr<function, Path>, f: ptr<function, Flight>) {}

// What a path meets that leaves the volume.
fn met(d: vec3<f32>, chance: f32) -> Spectrum {
    return spectrum(job.background);
}
