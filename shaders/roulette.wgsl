// Below this weight roulette is played, and survived with the chance SURVIVAL, which two random bits can decide.
const ROULETTE = 0.1;
const SURVIVAL = 0.25;

// Whether photons are followed to all orders, and play it.
override UNLIMITED: bool = true;
