//! From tallies to the outcome: deterministic orders are added, errors taken, the energy balance drawn up.

use super::angular::Towards;
use super::emit::hit_fraction;
use super::energies::Energies;
use super::gather::Volumes;
use super::light::Illumination;
use super::pixel_error;
use super::unscattered::{Aim, Balance, balance};
use crate::backend::shot::{Shot, of_one_photon, per_unit, source_of_one_photon};
use crate::backend::single::{Single, single};
use crate::backend::{Control, Device};
use crate::error::Result;
use crate::plan::{Direct, Emission, Plan, REPLICATES};
use crate::result::{Energy, Order0, Outcome, Share};
use crate::scene::field::{Field, Occupancy};
use crate::scene::{Albedo, Light};
use crate::tally::Moments;
use rayon::prelude::*;

/// 1 / (4 pi).
const PER_SPHERE: f32 = 0.25 * std::f32::consts::FRAC_1_PI;

/// Sums up what the photons of a run left; `direct` is what unscattered light leaves, if that was looked for.
pub fn settle(plan: &Plan, mut shot: Shot, direct: Option<Single>) -> Outcome {
    let channels = plan.channels;
    let values = plan.scene.medium.volume.voxels() * channels;
    let energy = energy(plan, &shot);
    let order0 = direct.map(|direct| order0(plan, direct));
    let count = shot.batches;
    let tallied = !plan.layers.is_empty() && count > 0;

    let absorbed = plan.finds_absorbed().then(|| {
        let mut mean = vec![0.0; values];
        let mut error = vec![0.0; values];
        if tallied {
            let largest = plan.largest_absorption();
            let of = |units: [f64; 3]| -> [f64; 3] { std::array::from_fn(|c| units[c] * largest[c]) };
            let unit = of(per_unit(plan, shot.powers));
            let one = of(of_one_photon(plan, &shot));
            (mean, error) = shot.absorbed.settle(&unit[..channels], &one[..channels], count);
            // Of what is empty nothing is absorbed.
            let (density, n) = (Field::density(&plan.scene.medium.volume), plan.scene.medium.volume.n());
            error.par_chunks_mut(channels).enumerate().for_each(|(voxel, error)| {
                if density.voxel_mean([voxel % n[0], voxel / n[0] % n[1], voxel / (n[0] * n[1])]) == 0.0 {
                    error.fill(0.0);
                }
            });
        }
        (mean, error)
    });

    let fluence = plan.settings.fluence.then(|| {
        let mut mean = vec![0.0; values];
        let mut error = vec![0.0; values];
        if tallied {
            let unit = per_unit(plan, shot.powers);
            (mean, error) = shot.fluence.settle(&unit[..channels], &of_one_photon(plan, &shot)[..channels], count);
        }
        (mean, error)
    });

    // J towards the eye of the run with its error, for the voxels' radiance; and for images J, or its harmonics.
    let one_photon = source_of_one_photon(plan, &shot);
    let (mut seen, mut seen_error) = (None, vec![0.0f32; if plan.settings.radiance { values } else { 0 }]);
    let mut source = None;
    if tallied && plan.wants_source() {
        let (moments, scale) =
            if plan.one_moment() { (&shot.fluence, f64::from(PER_SPHERE)) } else { (&shot.source, 1.0) };
        if !moments.mean.is_empty() {
            let unit = per_unit(plan, shot.powers).map(|unit| unit * scale);
            let (mean, spread) = moments.settle(&unit[..channels], &one_photon[..channels], count);
            seen = Some(mean);
            if plan.settings.radiance {
                seen_error = spread;
            }
        }
        if plan.settings.image && (plan.width() > 1 || seen.is_none()) {
            source = Some(mean_of_sums(&shot.subvolumes, count));
        }
    }
    let unreached = {
        let moments = if shot.fluence.mean.is_empty() { &shot.source } else { &shot.fluence };
        if tallied { moments.unreached(channels) } else { None }
    };
    shot.fluence = Moments::default();
    shot.source = Moments::default();

    let radiance = plan.settings.radiance.then(|| {
        let mut mean = seen.clone().unwrap_or_else(|| vec![0.0; values]);
        let mut error = seen_error;
        reflect(plan, &mut mean);
        reflect(plan, &mut error);
        (mean, error)
    });

    let mut source = source.or(seen);
    let mut source0 = None;
    if tallied && !shot.source0.is_empty() && plan.settings.image {
        let sampled: Vec<f32> = shot.source0.par_iter().map(|x| (*x / count as f64) as f32).collect();
        let least = if plan.width() > 1 { f32::NEG_INFINITY } else { 0.0 };
        if let Some(j) = &mut source {
            j.par_iter_mut().zip(&sampled).for_each(|(j, s)| *j = (*j - s).max(least));
        }
        source0 = Some(sampled);
    }
    let source = source.filter(|_| plan.settings.image && shot.has_scattered(plan));
    let (subvolumes, replicates) = if plan.subvolumes > 0 { replicates(&mut shot) } else { (None, 0) };
    let mut warnings = plan.warnings.clone();
    warnings.extend(shot.warning.take());
    if plan.shoots() && count == 1 {
        warnings.push("one batch of photons only: standard errors are not known (infinite)".into());
    }
    Outcome {
        pixels: None,
        fluence,
        radiance,
        absorbed,
        source,
        source0,
        subvolumes,
        replicates,
        unreached,
        one_photon,
        columns: Vec::new(),
        energy,
        order0,
        photons: shot.photons,
        collisions: shot.energies.iter().map(|e| e.0.collisions).sum(),
        batches: count,
        degrees_of_freedom: degrees_of_freedom(plan, count),
        seconds: [0.0; 3],
        stopped: shot.stopped,
        warnings,
    }
}

/// J towards the eye as the radiance that each voxel reflects; what is infinite stays so only where anything is reflected.
fn reflect(plan: &Plan, values: &mut [f32]) {
    let albedo = |at: usize| match plan.scene.medium.albedo {
        Albedo::Constant(a) => a.rgb[at % plan.channels] as f32,
        Albedo::PerVoxel(a) => a[at / plan.channels],
    };
    values.par_iter_mut().enumerate().for_each(|(at, value)| {
        let albedo = albedo(at);
        *value = if albedo > 0.0 { *value * albedo } else { 0.0 };
    });
}

/// What unscattered light adds to the voxels of a run.
pub fn order0(plan: &Plan, direct: Single) -> Order0 {
    let (mut radiance, mut error) = (direct.source, direct.source_error);
    reflect(plan, &mut radiance);
    reflect(plan, &mut error);
    Order0 {
        fluence: plan.settings.fluence.then_some((direct.fluence, direct.fluence_error)),
        radiance: plan.settings.radiance.then_some((radiance, error)),
        absorbed: plan.finds_absorbed().then_some((direct.absorbed, direct.absorbed_error)),
    }
}

/// The least degrees of freedom among what the standard errors of voxels are made of.
fn degrees_of_freedom(plan: &Plan, batches: u64) -> u64 {
    let rays = plan.lights.iter().any(|light| matches!(light.direct, Direct::Rays(_)));
    let photons = (batches > 0).then(|| batches - 1);
    photons.into_iter().chain(rays.then_some(REPLICATES - 1)).min().unwrap_or(0)
}

impl Shot {
    /// Whether photons of incident orders >= 1 were tallied.
    fn has_scattered(&self, plan: &Plan) -> bool {
        use crate::plan::Layer;
        plan.layers.iter().any(|l| match l {
            Layer::Inner => plan.scene.medium.phase.is_isotropic(),
            Layer::Eye | Layer::Harmonics => true,
            _ => false,
        })
    }
}

/// The replicates as means over their batches, the replicate fastest; `None` if there are fewer than two.
fn replicates(shot: &mut Shot) -> (Option<Vec<f32>>, usize) {
    // Stopped within the first round, a run has those replicates that got a batch, which are the first.
    let used = shot.subvolume_batches.iter().filter(|&&b| b > 0).count();
    if used < 2 {
        return (None, 0);
    }
    let means = interleaved(&shot.subvolumes[..used], &shot.subvolume_batches[..used]);
    shot.subvolumes = Vec::new();
    (Some(means), used)
}

/// The mean over all batches, from the sums of the replicates.
fn mean_of_sums(sums: &[Vec<f32>], batches: u64) -> Vec<f32> {
    let scale = 1.0 / batches as f64;
    let mean = |at: usize| (sums.iter().map(|sum| f64::from(sum[at])).sum::<f64>() * scale) as f32;
    (0..sums[0].len()).into_par_iter().map(mean).collect()
}

/// Sums of batches as means, side by side.
fn interleaved(sums: &[Vec<f32>], batches: &[u64]) -> Vec<f32> {
    let k = sums.len();
    let mut means = vec![0.0f32; k * sums[0].len()];
    means.par_chunks_mut(k).enumerate().for_each(|(at, list)| {
        for (r, mean) in list.iter_mut().enumerate() {
            *mean = sums[r][at] / batches[r].max(1) as f32;
        }
    });
    means
}

/// The energy balance: what the photons found, and of lights whose photons do not sample it what misses the box, passes
/// unscattered, or collides.
fn energy(plan: &Plan, shot: &Shot) -> Energy {
    let scene = plan.scene;
    let size = scene.medium.volume.size();
    let mut energy = Energy::default();
    let photons: f64 = shot.energies.iter().map(|e| e.1 as f64).sum();
    for c in 0..plan.channels {
        let watts = |(batch, count): &(Energies, u64), share| batch.get(share, c) * shot.powers[c] / *count as f64;
        for batch in &shot.energies {
            for (share, _) in Share::ALL {
                energy.fractions[share.index()][c] += watts(batch, share) * batch.1 as f64 / photons;
            }
        }
        let error = |of: &dyn Fn(&(Energies, u64)) -> f64| spread(shot.energies.iter().map(of));
        energy.error[c] = error(&|batch| Share::ALL.iter().map(|&(share, _)| watts(batch, share)).sum());
        energy.unscattered_error[c] = error(&|batch| watts(batch, Share::Unscattered));
        energy.absorbed_error[c] = error(&|batch| watts(batch, Share::Absorbed));
    }
    for (at, (light, how)) in scene.lights.iter().zip(&plan.lights).enumerate() {
        let emitted = light.launched(size);
        (0..plan.channels).for_each(|c| energy.launched[c] += emitted[c]);
        let value = light.value().rgb;
        // Of a light of value 1.
        let quiet = how.emission == Emission::Nothing;
        let sphere = 4.0 * std::f64::consts::PI;
        let rays =
            || Aim::new(&scene.medium.volume, light).map(|aim| balance(scene, (at, &aim), plan.settings.seed, quiet));
        let (missed, found) = match (light, how.emission) {
            // Photons are sampled in a cone around the box; all else misses.
            (Light::Point { position, .. }, Emission::AtLight) => {
                (sphere - super::emit::cone_solid_angle(scene.medium.volume.local(*position), size), None)
            }
            (Light::Point { position, .. }, _) => (sphere * (1.0 - hit_fraction(scene, *position)), rays()),
            (Light::Directional { .. }, Emission::FirstCollision | Emission::Nothing) => (0.0, rays()),
            (Light::Pencil { position, direction, .. }, emission) => {
                match Balance::of_beam(scene, *position, *direction) {
                    None => (1.0, None),
                    Some(_) if emission == Emission::AtLight => (0.0, None),
                    found => (0.0, found),
                }
            }
            _ => (0.0, None),
        };
        let found = found.unwrap_or_default();
        for c in 0..plan.channels {
            let mut add = |share: Share, part: f64| energy.fractions[share.index()][c] += value[c] * part;
            add(Share::Missed, missed);
            add(Share::Unscattered, found.through[c]);
            let more = |error: &mut [f64; 3], of: f64| error[c] = error[c].hypot(value[c] * of);
            more(&mut energy.unscattered_error, found.error[c]);
            if quiet {
                add(Share::Absorbed, found.absorbed[c]);
                add(Share::Truncated, found.scattered[c]);
                more(&mut energy.absorbed_error, found.absorbed_error[c]);
            } else {
                // Collisions are the photons'; of quiet lights all shares are found together.
                more(&mut energy.error, found.error[c]);
            }
        }
    }
    if let Some(emission) = &scene.medium.emission {
        let power = emission.power(&scene.medium.volume);
        (0..plan.channels).for_each(|c| energy.launched[c] += power[c]);
    }
    for c in 0..plan.channels {
        let launched = energy.launched[c];
        if launched > 0.0 {
            energy.fractions.iter_mut().for_each(|share| share[c] /= launched);
            for error in [&mut energy.error, &mut energy.unscattered_error, &mut energy.absorbed_error] {
                error[c] /= launched;
            }
            energy.imbalance[c] = (0..Share::COUNT).map(|s| energy.fractions[s][c]).sum::<f64>() - 1.0;
        } else {
            energy.fractions.iter_mut().for_each(|share| share[c] = 0.0);
            for error in [&mut energy.error, &mut energy.unscattered_error, &mut energy.absorbed_error] {
                error[c] = 0.0;
            }
        }
    }
    energy
}

/// The standard error of the mean of some values: infinite of a single one, 0 of none.
fn spread(values: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let k = values.len() as f64;
    if k < 2.0 {
        return if k == 1.0 { f64::INFINITY } else { 0.0 };
    }
    let mean = values.clone().sum::<f64>() / k;
    (values.map(|value| (value - mean).powi(2)).sum::<f64>() / (k * (k - 1.0))).sqrt()
}

/// The relative noise and bias that `target_error` bounds together, as they stand; over voxels they take order 0,
/// which is found once.
pub fn relative_error(
    plan: &Plan,
    device: &Device,
    views: &[Option<Illumination>],
    shot: &mut Shot,
    order0: &mut Option<Single>,
    occupancy: Option<&Occupancy>,
    control: &Control,
) -> Result<(f64, f64)> {
    let channels = plan.channels;
    if plan.layers.is_empty() || shot.batches < 2 {
        return Ok((0.0, 0.0));
    }
    if !plan.over_pixels() {
        let (moments, one) = if shot.fluence.mean.is_empty() {
            (&shot.source, source_of_one_photon(plan, shot))
        } else {
            (&shot.fluence, of_one_photon(plan, shot))
        };
        let count = shot.batches;
        let unit = per_unit(plan, shot.powers);
        let (mut values, mut errors) = moments.settle(&unit[..channels], &one[..channels], count);
        if !shot.fluence.mean.is_empty() && plan.settings.fluence {
            let found = match order0 {
                Some(found) => found,
                none => none.insert(single(plan, control)?),
            };
            values.par_iter_mut().zip(&found.fluence).for_each(|(value, order0)| *value += order0);
            errors.par_iter_mut().zip(&found.fluence_error).for_each(|(error, order0)| *error = error.hypot(*order0));
        }
        return Ok(pixel_error::relative(&values, &errors, None, channels));
    }
    let camera = &plan.scene.camera;
    let pixels = pixel_sample(camera.resolution);
    let lights: Vec<Illumination> = views.iter().flatten().cloned().collect();
    let Some((means, k)) = replicates_seen(plan, device, shot)? else { return Ok((0.0, 0.0)) };
    let volumes = Volumes { scene: plan.scene, occupancy, lights, source: Some(&means), source0: None, channels };
    let stop = || control.stopped();
    let picture = device.image(&volumes, camera, Some(&pixels), channels * k, true, &stop)?;
    let (more, errors) = pixel_error::spread(&picture.order2, k);
    let own = picture.order1.iter().zip(&picture.emitted);
    let values: Vec<f32> = more.iter().zip(own).map(|(more, (once, emitted))| more + once + emitted).collect();
    let (whole, _) = pixel_error::spread(&means, k);
    let bias = pixel_error::bias(device, &volumes, &whole, camera, Some(&pixels), &stop)?;
    Ok(pixel_error::relative(&values, &errors, Some(&bias), channels))
}

/// The replicates' J towards the eye of the run, the replicate fastest, and their number; `None` if no photon left any.
pub fn replicates_seen(plan: &Plan, device: &Device, shot: &Shot) -> Result<Option<(Vec<f32>, usize)>> {
    let used = shot.subvolume_batches.iter().filter(|&&batches| batches > 0).count();
    let (mut means, k) = if used > 0 {
        (interleaved(&shot.subvolumes[..used], &shot.subvolume_batches[..used]), used)
    } else {
        let (moments, scale) =
            if plan.one_moment() { (&shot.fluence, f64::from(PER_SPHERE)) } else { (&shot.source, 1.0) };
        let unit = per_unit(plan, shot.powers);
        let mean = |(at, x): (usize, &f64)| (x * unit[at % plan.channels] * scale) as f32;
        (moments.mean.par_iter().enumerate().map(mean).collect(), 1)
    };
    if means.is_empty() {
        return Ok(None);
    }
    if let Some(order) = plan.harmonics.filter(|_| plan.width() > 1) {
        let camera = &plan.scene.camera;
        means = device.contract(&Towards::new(plan.scene, camera, order), &means, plan.channels * k)?;
    }
    Ok(Some((means, k)))
}

/// At most 1024 pixels, evenly over the image.
fn pixel_sample(resolution: [usize; 2]) -> Vec<usize> {
    let [width, height] = resolution;
    let step = (((width * height) as f64 / 1024.0).sqrt().ceil() as usize).max(1);
    let offset = step / 2;
    (offset.min(height - 1)..height)
        .step_by(step)
        .flat_map(|y| (offset.min(width - 1)..width).step_by(step).map(move |x| y * width + x))
        .collect()
}
