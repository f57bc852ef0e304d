// The paths that are under way: a view ray and one of its paths for each slot, kept from dispatch to dispatch.

struct Path {
    // The view ray: where it enters the medium, in voxels, and its length within.
    entry: vec3<f32>,
    length: f32,
    direction: vec3<f32>,
    // What a weight of 1 on one of its paths stands for.
    share: f32,
    // 1 - transmittance of the whole ray by channel, and the largest of them.
    opacity: vec3<f32>,
    top: f32,
    // The ray's number in the job, and how many of its paths have begun.
    ray: u32,
    begun: u32,
    // What is to happen next.
    state: u32,
    // Scatterings so far.
    order: u32,
    // The density of the direction in which the path was scattered last, where that matters.
    chance: f32,
    // Light that was scattered once, and more often.
    one: Spectrum,
    more: Spectrum,
    weights: Weights,
    // Where the flight began, and with which weights, where that matters.
    from_point: vec3<f32>,
    before: Weights,
    flight: Flight,
}

// Where a near light is seen: a pixel, and the place in it from its upper left corner.
struct Image {
    pixel: vec2<i32>,
    place: vec2<f32>,
}

struct Job {
    // The image, and the columns and rows of pixels that may see the medium: the first ones, and how many.
    resolution: vec2<u32>,
    first: vec2<u32>,
    columns: u32,
    // View rays of each pixel.
    count: u32,
    // Number of the first view ray of pixel 0 among all of the seed.
    number: vec2<u32>,
    // The first pixel of the job among those that may see the medium, and the job's view rays.
    pixel: u32,
    rays: u32,
    // View rays under way at once, and steps of each in a dispatch.
    slots: u32,
    steps: u32,
    // Radiance that is met on leaving the volume wherever that is, by channel; near lights that the image shows.
    background: vec3<f32>,
    images: u32,
    // The slots of this dispatch.
    slot: u32,
    end: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(20) var<storage, read_write> paths: array<Path>;
// Slots that are not over, and real collisions.
@group(0) @binding(21) var<storage, read_write> counters: array<atomic<u32>, 2>;
// What each view ray sees: light that was scattered once, and more often, channel by channel.
@group(0) @binding(25) var<storage, read_write> seen: array<f32>;

// Paths per view ray, and whether they begin at collisions drawn from a walk along it, or where it enters.
override STARTS: u32 = 4u;
override WALKED: bool = true;

// What is to happen to a slot: it is new; it has no rays left; it takes its next view ray, or the ray's next path; that
// collides; it flies; it pauses within a flight.
const NEW = 0u;
const OVER = 1u;
const VIEWS = 2u;
const NEXT = 3u;
const HITS = 4u;
const FLIGHT = 5u;
const PAUSED = 6u;

// Adds light of a scattering order.
fn see(path: ptr<function, Path>, order: u32, light: Spectrum) {
    if order == 1u {
        (*path).one += light;
    } else {
        (*path).more += light;
    }
}
