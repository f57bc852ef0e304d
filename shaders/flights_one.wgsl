// Flights below one majorant.

// Flies to the next tentative collision, or out.
fn advance(f: ptr<function, Flight>) -> u32 {
    let q = (*f).p + (*f).d * scene.inverse_h * ((*f).depth * scene.free_path);
    (*f).q = q;
    (*f).free_path = scene.free_path;
    return select(LEFT, TENTATIVE, contains(q));
}
