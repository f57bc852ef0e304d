// Connections: the light that reaches a vertex of a path straight from a source and scatters along the path. A path runs
// against the light: at a vertex that it reached along `travel`, light that travels along l scatters into it by
// P(-l . travel).

// The first ones of `lights` are those that every vertex is connected to.
override FAR_LIGHTS: u32 = 0u;
// Whether light is met on leaving the volume, and whether it is there or on the way.
override SEES_OUT: bool = false;
override FLIES_OUT: bool = false;

// Transmittance of a column density, by channel.
fn through(column: f32) -> Spectrum {
    return expos(-spectrum(scene.extinction) * column);
}

// P(-l . travel) [1/sr].
fn phase_towards(l: vec3<f32>, travel: vec3<f32>) -> f32 {
    let cos_theta = -(l.x * travel.x + l.y * travel.y + l.z * travel.z);
    return phase_pdf(max(min(cos_theta, 1.0), -1.0));
}

// The radiance that all far lights scatter along the path at a vertex, over the albedo there.
fn scattered(f: ptr<function, Flight>) -> Spectrum {
    let p = (*f).p;
    var sum = Spectrum(0.0);
    for (var i = 0u; i < FAR_LIGHTS; i++) {
        let light = lights[i];
        let at = incident(light, p);
        let scale = phase_towards(at.direction, (*f).d) * at.falloff;
        var arrives = through(light_column(light, p, at));
        if light.check < 1.0 {
            let chance = correction(f, light.check);
            if chance > 0.0 {
                arrives += (through(light_ray(p, at)) - arrives) / chance;
            }
        }
        sum += spectrum(light.value) * scale * arrives;
    }
    return sum;
}
