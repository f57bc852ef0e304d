// Every tentative collision is real, for the majorant is the extinction.

// Moves to the tentative collision; whether it is real.
fn accept(f: ptr<function, Flight>) -> bool {
    (*f).p = (*f).q;
    (*f).xi = unit((*f).word.z);
    return true;
}
