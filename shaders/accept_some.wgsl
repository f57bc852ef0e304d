// Tentative collisions are real with the chance extinction / majorant.

// Moves to the tentative collision; whether it is real.
fn accept(f: ptr<function, Flight>) -> bool {
    (*f).p = (*f).q;
    let chance = density_read((*f).q, (*f).word.y) * scene.top_extinction * (*f).free_path;
    let xi = unit((*f).word.z);
    (*f).xi = min(xi / chance, 1.0);
    return xi <= chance;
}
