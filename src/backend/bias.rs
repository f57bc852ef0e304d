//! How far a picture of dense voxels is off, measured. What is scattered in a voxel is kept as its mean, and seen from its
//! first mean free path; where a voxel is thicker than that, neighbouring voxels do not tell what lies between. Paths from the
//! camera have no voxels: they see a coarse copy of the picture.

use super::cpu::gather::Volumes;
use super::cpu::light::Illumination;
use super::cpu::{path, pixel_error, settle};
use super::shot::Shot;
use super::{Control, Device};
use crate::error::Result;
use crate::plan::{Angular, Method, Plan, Settings};
use crate::scene::field::Occupancy;
use crate::scene::{Camera, Scene};

/// Pixels of the coarse copy, and paths on each.
const PIXELS: usize = 64;
const PATHS: u64 = 512;
/// The part of a run's time that they may take.
const SHARE: f64 = 0.25;
/// A bias from which on the user is told.
const VISIBLE: f64 = 0.02;

/// The coarse copy of a picture that paths see.
pub struct Truth {
    camera: Camera,
    values: Vec<f32>,
    errors: Vec<f32>,
}

/// The bias of a picture over the truth's mean, of the channel in which it is worst.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bias {
    /// Its root mean square over the pixels above 5 % of the maximum.
    pub size: f64,
    /// Its mean over them; negative where the picture is too dark.
    pub mean: f64,
}

impl Truth {
    /// What paths see, if the plan asks for it.
    pub fn trace(plan: &Plan, control: &Control) -> Result<Option<Self>> {
        if plan.dense.is_none() {
            return Ok(None);
        }
        let camera = plan.scene.camera.coarse(PIXELS);
        let scene = Scene { camera, ..plan.scene.clone() };
        let settings = Settings {
            method: Some(Method::Path),
            photons: None,
            spp: Some(PATHS),
            target_error: None,
            time_limit: None,
            angular: Angular::Eye,
            fluence: false,
            radiance: false,
            adapter: None,
            force: true,
            ..plan.settings.clone()
        };
        let paths = Plan::new(&scene, &settings)?;
        let (outcome, _) = path::run(&paths, &Device::Cpu, &control.part(SHARE), None)?;
        Ok(outcome.pixels.map(|seen| {
            let values = seen.order1.iter().zip(&seen.order2).map(|(one, more)| one + more).collect();
            Truth { camera, values, errors: seen.error }
        }))
    }

    /// How far the picture of what was shot is from it; found on the CPU, where no device can fail that has done its work.
    pub fn bias(
        &self,
        plan: &Plan,
        views: &[Option<Illumination>],
        shot: &Shot,
        occupancy: Option<&Occupancy>,
        control: &Control,
    ) -> Result<Bias> {
        let seen = settle::replicates_seen(plan, &Device::Cpu, shot)?;
        // The noise of a single replicate is not known.
        let Some((source, k)) = seen.filter(|seen| seen.1 > 1) else { return Ok(Bias::default()) };
        let (channels, lights) = (plan.channels, views.iter().flatten().cloned().collect());
        let source = Some(source.as_slice());
        let volumes = Volumes { scene: plan.scene, occupancy, lights, source, source0: None, channels };
        let picture = Device::Cpu.image(&volumes, &self.camera, None, channels * k, false, &|| control.stopped())?;
        let (more, errors) = pixel_error::spread(&picture.order2, k);
        let values: Vec<f32> = more.iter().zip(&picture.order1).map(|(more, one)| more + one).collect();
        let mut worst = Bias::default();
        for c in 0..channels {
            let here = self.compare(&values, &errors, (c, channels));
            if here.size > worst.size {
                worst = here;
            }
        }
        Ok(worst)
    }

    /// The bias of one of the channels; what noise explains is none.
    fn compare(&self, values: &[f32], errors: &[f32], (c, channels): (usize, usize)) -> Bias {
        let pick = |list: &[f32], at: usize| f64::from(list[at * channels + c]);
        let places = || 0..self.values.len() / channels;
        let top = places().map(|at| pick(&self.values, at)).fold(0.0, f64::max);
        let (mut truth, mut mean, mut square, mut count) = (0.0, 0.0, 0.0, 0.0);
        let (mut noise, mut own2, mut shared) = (0.0, 0.0, 0.0);
        for at in places().filter(|&at| pick(&self.values, at) > 0.05 * top) {
            let (own, other) = (pick(&self.errors, at), pick(errors, at));
            let difference = pick(values, at) - pick(&self.values, at);
            count += 1.0;
            truth += pick(&self.values, at);
            mean += difference;
            square += difference * difference;
            noise += own * own + other * other;
            own2 += own * own;
            // Pixels of photons share them.
            shared += other;
        }
        if truth <= 0.0 {
            return Bias::default();
        }
        let (square, mean) = ((square - noise) / count, mean / count);
        let of_mean = (own2.sqrt() / count).hypot(shared / count);
        let size = square.max(mean * mean - of_mean * of_mean).max(0.0).sqrt();
        Bias { size: size * count / truth, mean: mean * count / truth }
    }
}

impl Bias {
    /// What the user should know, if the picture is visibly off.
    pub fn warning(&self, plan: &Plan) -> Option<String> {
        let side = if self.mean < 0.0 { "dark" } else { "bright" };
        let depth = plan.dense.unwrap_or(0.0);
        (self.size > VISIBLE).then(|| {
            format!(
                "the bias of the voxels' size is {:.2e}: the picture is too {side} by about {:.0} %, for the voxels that are \
                 seen are {depth:.1} mean free paths thick; smaller voxels have less bias, and method = \"path\", \
                 outputs = (\"image\",) has none",
                self.size,
                100.0 * self.size
            )
        })
    }
}
