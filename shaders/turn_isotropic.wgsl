// Scatters into a direction that is uniform over the sphere.
fn turn(f: ptr<function, Flight>) {
    (*f).d = sphere((*f).xi, azimuth((*f).word.w));
}
