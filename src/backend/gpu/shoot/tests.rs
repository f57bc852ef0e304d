//! Photons on a device against those of the CPU, one by one; and tallies at their ends.

use super::*;
use crate::backend::cpu::lanes::Laned;
use crate::backend::cpu::shoot::{Engine, OneByOne, Task, Walk};
use crate::backend::cpu::track::{Analytic, March, Woodcock};
use crate::backend::gpu::adapter;
use crate::backend::gpu::device::for_tests;
use crate::backend::gpu::kernel::span;
use crate::backend::gpu::kernels;
use crate::backend::views::{illuminations, light_grids};
use crate::physics::Phase;
use crate::plan::{Method, Settings, Simd, Tracker};
use crate::result::EXIT_FACES;
use crate::scene::environment::Map;
use crate::scene::field::{Field, Occupancy};
use crate::scene::{Albedo, Camera, Emission, Light, Medium, Scene, Spectrum, Volume};

const N: [usize; 3] = [11, 10, 9];
const VOXELS: usize = 990;

fn random(seed: u32, gaps: f32) -> Vec<f32> {
    let word = |i: u32| crate::physics::rng::words([seed, 0], [i, 0], 0, 0)[0];
    (0..VOXELS as u32).map(|i| crate::physics::rng::uniform(word(i))).map(|x| if x < gaps { 0.0 } else { x }).collect()
}

/// What a case varies.
struct Case {
    n: [usize; 3],
    density: Vec<f32>,
    linear: bool,
    extinction: Vec<f64>,
    albedo: Option<Vec<f32>>,
    phase: Phase,
    light: Option<Light>,
    emission: Option<(Vec<f32>, usize)>,
    settings: Settings,
}

impl Case {
    fn new() -> Self {
        Case {
            n: N,
            density: random(1, 0.3),
            linear: true,
            extinction: vec![0.8],
            albedo: None,
            phase: Phase::Isotropic,
            light: Some(Light::point([-6.0, -9.0, 16.0], &[1e3]).expect("valid")),
            emission: None,
            settings: Settings { method: Some(Method::Photon), photons: Some(4000), seed: 7, ..Settings::default() },
        }
    }

    /// Runs `check` on the plan and its emitters.
    fn with<T>(&self, check: impl FnOnce(&Plan, &[Emitter]) -> T) -> T {
        let volume = Volume::new(&self.density, self.n, [1.1, 0.9, 1.0], [0.0; 3], self.linear).expect("valid");
        let spectrum = |v: &[f64]| Spectrum::new(v, "value").expect("valid");
        let albedo = match &self.albedo {
            Some(values) => Albedo::PerVoxel(values),
            None => Albedo::Constant(spectrum(&[0.9])),
        };
        let medium = Medium::new(volume, spectrum(&self.extinction), albedo, self.phase.clone()).expect("valid");
        let emission =
            self.emission.as_ref().map(|(values, channels)| Emission::new(values, *channels, &medium.volume));
        let medium = medium.emitting(emission.map(|e| e.expect("valid")));
        let camera =
            Camera::perspective([30.0, -20.0, 12.0], [5.5, 5.0, 4.5], [0.0, 0.0, 1.0], 26.0, [9, 9]).expect("valid");
        let scene = Scene::new(medium, self.light.iter().cloned().collect(), camera);
        let plan = Plan::new(&scene, &self.settings).expect("it can be planned");
        let occupancy = Occupancy::new(&scene.medium.volume);
        let columns = light_grids(&plan, occupancy.as_ref(), &Control::new(None));
        let views = illuminations(&scene, occupancy.as_ref(), plan.lights.iter().map(|l| l.column), &columns);
        let lights = scene.lights.iter().zip(&plan.lights).zip(&views);
        let emitters: Vec<Emitter> = lights
            .filter_map(|((light, how), view)| Emitter::new(&scene, light, how, view.as_ref()))
            .chain(Emitter::medium(&scene))
            .collect();
        check(&plan, &emitters)
    }
}

fn cases() -> Vec<(&'static str, Case)> {
    let one = || Case::new();
    let scalar = || Settings { simd: Some(Simd::Scalar), ..one().settings };
    let tracked = |tracker| Settings { tracker: Some(tracker), ..one().settings };
    let hg = |g| Phase::henyey_greenstein(g).expect("valid");
    let table = Phase::tabulated(&[-1.0, 0.0, 0.8, 1.0], &[1.0, 0.2, 1.0, 6.0]).expect("valid");
    let texels: Vec<f32> = (0..96).map(|i| if i % 7 == 3 { 40.0 } else { (i % 5) as f32 }).collect();
    let map = |channels| Map::new(texels.clone(), 96 / channels / 4, 4, channels).expect("valid");
    let light = |light: Result<Light>| Some(light.expect("valid"));
    let ones = || vec![1.0; VOXELS];
    vec![
        ("linear", one()),
        ("nearest", Case { linear: false, phase: Phase::Rayleigh, ..one() }),
        ("homogeneous", Case { density: ones(), phase: hg(0.6), ..one() }),
        ("backward", Case { phase: hg(-0.7), ..one() }),
        ("tabulated", Case { phase: table, ..one() }),
        ("sparse", Case { density: random(2, 0.97), extinction: vec![8.0], ..one() }),
        ("albedo", Case { albedo: Some(random(3, 0.1)), ..one() }),
        ("one scattering", Case { settings: Settings { max_scatterings: Some(2), ..one().settings }, ..one() }),
        (
            "directional",
            Case { light: light(Light::directional([0.3, -0.2, -1.0], &[1.0])), extinction: vec![3.0], ..one() },
        ),
        ("pencil", Case { light: light(Light::pencil([5.2, 4.1, -3.0], [0.1, 0.2, 1.0], &[1.0])), ..one() }),
        ("inside", Case { light: light(Light::point([5.1, 5.3, 4.2], &[1.0])), ..one() }),
        ("far", Case { light: light(Light::point([-6e6, -9e6, 16e6], &[1.0])), extinction: vec![3.0], ..one() }),
        ("environment", Case { light: light(Light::environment(&[1.0])), ..one() }),
        ("map", Case { light: light(Light::environment_map(map(1))), ..one() }),
        ("map RGB", Case { light: light(Light::environment_map(map(3))), ..one() }),
        ("emission", Case { light: None, emission: Some((random(4, 0.6), 1)), ..one() }),
        ("scalar", Case { settings: scalar(), ..one() }),
        ("scalar sparse", Case { density: random(2, 0.97), extinction: vec![8.0], settings: scalar(), ..one() }),
        ("scalar homogeneous", Case { density: ones(), settings: scalar(), ..one() }),
        ("march", Case { settings: tracked(Tracker::March), ..one() }),
        ("march nearest", Case { linear: false, settings: tracked(Tracker::March), ..one() }),
        ("march homogeneous", Case { density: ones(), settings: tracked(Tracker::March), ..one() }),
        ("chromatic", Case { extinction: vec![0.5, 0.8, 1.2], settings: tracked(Tracker::Woodcock), ..one() }),
        ("chromatic march", Case { extinction: vec![0.5, 0.8, 1.2], settings: tracked(Tracker::March), ..one() }),
    ]
}

/// The adapter of these tests, opened for each anew.
fn gpu() -> Option<Gpu> {
    for_tests().map(|_| Gpu::new(&adapter::choose("").expect("an adapter")).expect("it opens"))
}

/// Collisions and the last share of each photon on the CPU.
fn fates_of_the_cpu(plan: &Plan, emitters: &[Emitter]) -> Vec<[u32; 2]> {
    fn walk<E: Engine>(plan: &Plan, emitters: &[Emitter], engine: E) -> Vec<[u32; 2]> {
        let count = plan.settings.photons.expect("given");
        let new = |layer: &crate::plan::Layer| vec![Bins::new(VOXELS * plan.channels * plan.width_of(*layer), true)];
        let bins = plan.layers.iter().map(new).collect();
        let walk = Walk { plan, emitters, bins, sets: 1, units: [1.0; 3] };
        let fate = |j: u64| {
            let task = Task { emitter: &emitters[0], scale: [1.0; 3], first: 0, count, range: j..j + 1 };
            let mut energies = Energies::default();
            engine.task(&walk, &task, &mut energies, &|| false);
            let met = |share: &Share| (0..3).any(|c| energies.get(*share, c) > 0.0);
            let ends = [Share::Missed, Share::Unscattered, Share::Truncated];
            let end = ends.iter().chain(&EXIT_FACES).find(|share| met(share)).unwrap_or(&Share::Absorbed);
            [energies.collisions as u32, end.index() as u32]
        };
        (0..count).map(fate).collect()
    }
    let medium = &plan.scene.medium;
    let field = Field::density(&medium.volume);
    let extinction = medium.extinction.rgb.map(|e| e as f32);
    let scores = true;
    match (plan.lanes, plan.chromatic, plan.tracker, &plan.majorant) {
        (true, ..) if plan.channels == 1 => walk(plan, emitters, Laned::<1>::new(plan)),
        (true, ..) => walk(plan, emitters, Laned::<3>::new(plan)),
        (_, false, Tracker::Woodcock, Some(grid)) => {
            walk(plan, emitters, OneByOne::<_, 1>(Woodcock::<false>::new(plan, grid)))
        }
        (_, true, Tracker::Woodcock, Some(grid)) => {
            walk(plan, emitters, OneByOne::<_, 3>(Woodcock::<true>::new(plan, grid)))
        }
        (_, _, Tracker::Analytic, _) => {
            let sigma_t = medium.max_sigma_t() as f32;
            walk(plan, emitters, OneByOne::<_, 1>(Analytic { field, sigma_t, score: plan.score, scores }))
        }
        (_, false, ..) => walk(plan, emitters, OneByOne::<_, 1>(March::<false> { field, extinction, scores })),
        (_, true, ..) => walk(plan, emitters, OneByOne::<_, 3>(March::<true> { field, extinction, scores })),
    }
}

#[test]
fn photons_meet_the_fates_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let (mut all, mut other) = (0, 0);
    for (name, case) in cases() {
        case.with(|plan, emitters| {
            let count = plan.settings.photons.expect("given");
            let mut shooting = Shooting::watching(&gpu, plan, emitters, count as usize).expect("it compiles");
            let ended = shooting.batch(0, count, &Control::new(None), false).expect("it runs");
            assert!(ended.is_some(), "{name}");
            let mut here = shooting.fates(count as usize).expect("they can be read");
            // What the energies of one photon cannot tell apart.
            here.iter_mut().filter(|fate| fate[1] == Share::Roulette.index() as u32).for_each(|fate| {
                fate[1] = Share::Absorbed.index() as u32;
            });
            let there = fates_of_the_cpu(plan, emitters);
            let differ = here.iter().zip(&there).filter(|(a, b)| a != b).count();
            println!("{name}: {differ} of {count} photons meet another fate");
            // Rounding decides for a photon in a thousand at most.
            assert!(differ * 1000 <= 2 * count as usize, "{name}: {differ} of {count} photons meet another fate");
            let kinds: std::collections::HashSet<_> = here.iter().collect();
            assert!(kinds.len() > 5, "{name}: only {kinds:?}");
            all += count as usize;
            other += differ;
        });
    }
    println!("in all {other} of {all}");
    assert!(other * 5000 <= all, "in all {other} of {all}");
}

#[test]
fn dispatches_of_any_length_leave_the_same_bits() {
    let Some(gpu) = gpu() else { return };
    for (name, case) in cases().into_iter().filter(|(name, _)| ["linear", "map RGB", "chromatic march"].contains(name))
    {
        case.with(|plan, emitters| {
            let run = |slots: u32, limit: u32| {
                let mut shooting = Shooting::new(&gpu, plan, emitters).expect("it compiles");
                shooting.slots = shooting.slots.min(slots);
                shooting.emitters.iter_mut().for_each(|emitter| emitter.2 = limit);
                let energies =
                    shooting.batch(0, 1000, &Control::new(None), false).expect("it runs").expect("to its end");
                let shares: Vec<f64> = Share::ALL.iter().map(|(share, _)| energies.get(*share, 0)).collect();
                (shooting.tally.read(&gpu).expect("it can be read"), shares, energies.collisions)
            };
            let whole = run(1024, 1000);
            assert!(whole.2 > 1000);
            assert!(whole == run(16, 1), "{name}");
            assert!(whole == run(7, 3), "{name}");
        });
    }
}

#[test]
fn tallies_in_parts_hold_the_same() {
    let (Some(whole), Some(mut parts)) = (gpu(), gpu()) else { return };
    parts.description.binding = 1 << 17;
    let n = [36, 35, 30];
    let photons = Settings { photons: Some(1000), ..Case::new().settings };
    let case = Case { n, density: vec![1.0; 36 * 35 * 30], extinction: vec![0.1], settings: photons, ..Case::new() };
    case.with(|plan, emitters| {
        let read = |gpu: &Gpu| {
            let mut shooting = Shooting::new(gpu, plan, emitters).expect("it compiles");
            shooting.batch(0, 1000, &Control::new(None), false).expect("it runs").expect("to its end");
            (shooting.tally.bindings().len(), shooting.tally.read(gpu).expect("it can be read"))
        };
        let (one, four) = (read(&whole), read(&parts));
        assert_eq!((one.0, four.0), (2, 8));
        assert!(one.1 == four.1);
        assert!(one.1[0].iter().filter(|&&units| units > 0).count() > 1000);
    });
    assert!(Tally::new(&parts, 1 << 18).is_err_and(|e| matches!(e, Error::VolumeTooLarge(_))));
}

#[test]
fn sums_cross_32_and_64_bits() {
    let Some(gpu) = gpu() else { return };
    let case = Case { density: vec![1.0; VOXELS], ..Case::new() };
    case.with(|plan, emitters| {
        let mut shooting = Shooting::new(&gpu, plan, emitters).expect("it compiles");
        let bins = VOXELS * plan.layers.len();
        let batch = |shooting: &mut Shooting, preset: u64| {
            shooting.preset = Some(preset);
            let ended = shooting.batch(0, 2000, &Control::new(None), false);
            let [low, high] = shooting.tally.read(&gpu).expect("it can be read");
            let sums: Vec<u64> = low.iter().zip(&high).map(|(l, h)| u64::from(*l) | u64::from(*h) << 32).collect();
            assert_eq!(sums.len(), bins);
            (ended.map(|ended| ended.is_some()), sums)
        };
        let (_, zero) = batch(&mut shooting, 0);
        let most = zero.iter().copied().max().unwrap_or(0);
        assert!(most > 100_000);
        for preset in [(1 << 32) - 1000, u64::MAX - 1000, (1 << 62) - 2 * most] {
            let (ended, sums) = batch(&mut shooting, preset);
            assert_eq!(ended, Ok(true), "{preset:x}");
            assert!(sums.iter().zip(&zero).all(|(sum, units)| *sum == preset.wrapping_add(*units)), "{preset:x}");
            assert!(shooting.bins().is_ok(), "{preset:x}");
        }
        // Beyond 2^62 it is said.
        for preset in [(1 << 62) - 1000, (1 << 63) - 1000, 1 << 63] {
            batch(&mut shooting, preset).0.expect("it runs");
            assert!(shooting.bins().is_err_and(|e| e.to_string().contains("2^62")), "{preset:x}");
        }
    });
}

#[test]
fn slots_hold_a_photon() {
    let shoots = |kernel: &Source| kernel.files()[0].starts_with("shoot");
    let spans = kernels().into_iter().filter(shoots).filter_map(|kernel| span(&kernel, "Photon"));
    assert_eq!(spans.max(), Some(PHOTON));
}
