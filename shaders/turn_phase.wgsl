// Scatters into a direction that the phase function gives.
fn turn(f: ptr<function, Flight>) {
    let polar = phase_sample((*f).xi);
    (*f).d = rotate((*f).d, polar.x, polar.y, azimuth((*f).word.w));
}
