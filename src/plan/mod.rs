//! The plan: pure data that says which kernels run on which tables, and why. Everything that the kind of scene decides is
//! decided here, once; the backends only follow.

mod angular;
mod batches;
pub mod cost;
mod dense;
mod explain;
mod layers;
mod lights;
pub mod majorant;
mod methods;
pub mod path;
mod probe;
pub mod settings;
mod tracker;

pub use batches::LARGEST_BATCH;
pub use explain::Decision;
pub use layers::{Layer, Route};
pub use lights::{Column, Direct, Emission, LightPlan, REPLICATES, Rays};
pub use majorant::{LEAST_SCORED_DEPTH, MajorantGrid, StepCosts};
pub use path::{Connection, PathPlan};
pub use settings::{Adapter, Angular, Method, Settings, Simd, Tracker};

use crate::error::{Result, scene_error};
use crate::physics::harmonics::count;
use crate::scene::{Albedo, Scene};
use cost::Memory;
use explain::Explain;

/// How fluence is scored along a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Score {
    /// weight / majorant at every tentative collision, where these are frequent enough.
    Collisions,
    /// weight * length in every voxel.
    Track,
}

/// What runs.
#[derive(Debug, Clone)]
pub struct Plan<'a> {
    /// The scene.
    pub scene: &'a Scene<'a>,
    /// The settings as given.
    pub settings: Settings,
    /// The method.
    pub method: Method,
    /// The tracker.
    pub tracker: Tracker,
    /// 1 or 3.
    pub channels: usize,
    /// Whether one walk must serve unequal extinctions.
    pub chromatic: bool,
    /// Whether photons are walked in lanes.
    pub lanes: bool,
    /// Highest scattering order, `u32::MAX` if unlimited.
    pub orders: u32,
    /// The majorant grid, for `Tracker::Woodcock`.
    pub majorant: Option<MajorantGrid>,
    /// How flights score.
    pub score: Score,
    /// The optical depth per voxel that the majorant has at least, where photons are walked one by one through a homogeneous
    /// medium and score at tentative collisions in whatever voxels.
    pub least_depth: Option<f64>,
    /// One entry per light.
    pub lights: Vec<LightPlan>,
    /// The tally layers that exist.
    pub layers: Vec<Layer>,
    /// Order of the spherical harmonics that anisotropic radiance is recorded in, if it is.
    pub harmonics: Option<usize>,
    /// Where incident orders 0, 1..n-1 and n go.
    pub routes: [Route; 3],
    /// The layer of absorption, an index into `layers`: it takes what the fluence takes.
    pub absorbed: Option<usize>,
    /// How paths run, for `Method::Path`.
    pub paths: Option<PathPlan>,
    /// Photons per batch; 0 if none are shot.
    pub batch_photons: u64,
    /// Number of batches, if the number of photons is given.
    pub batches: Option<u64>,
    /// Replicate volumes for pixel errors.
    pub subvolumes: usize,
    /// The relative error that stops the run.
    pub target_error: Option<f64>,
    /// The optical depth of the voxels that are seen, if pictures of photons kept in them are wrong by what paths can tell.
    pub dense: Option<f64>,
    /// Estimated seconds.
    pub seconds: f64,
    /// Estimated photons per second.
    pub photons_per_second: f64,
    /// Memory by part.
    pub memory: Memory,
    /// Each decision with its reason.
    pub decisions: Vec<Decision>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl<'a> Plan<'a> {
    /// Decides everything that the scene and the settings decide.
    pub fn new(scene: &'a Scene<'a>, settings: &Settings) -> Result<Self> {
        settings.validate()?;
        let mut why = Explain::default();
        let medium = &scene.medium;
        let volume = &medium.volume;
        let channels = scene.channels();
        let depth = voxel_depth(scene);
        let scatters = medium.max_albedo() > 0.0 && medium.max_sigma_t() > 0.0;
        let target_error = match (settings.target_error, settings.photons.or(settings.spp), settings.time_limit) {
            (None, None, None) => Some(methods::TARGET),
            (target, ..) => target,
        };

        why.device(settings);
        if settings.image {
            why.camera(&scene.camera);
        }
        let dense = dense::depth(scene, settings, scatters);
        let method = methods::choose(scene, settings, target_error, (scatters, dense), &mut why)?;
        let dense = dense.filter(|_| method == Method::Photon);
        if let Some(depth) = dense {
            why.push(
                "voxels",
                "a picture is held against paths, which have no voxels".into(),
                format!("those that are seen are {depth:.2} mean free paths thick"),
            );
        }
        if method == Method::Path && settings.angular != Angular::Eye {
            return scene_error(
                "angular is for method = \"photon\": paths are traced for one camera, and keep nothing else",
            );
        }
        if method == Method::Path && (settings.fluence || settings.radiance) {
            return scene_error(
                "outputs: method = \"path\" gives images only; use method = \"photon\" for values of voxels",
            );
        }
        let orders = match method {
            Method::Single => settings.max_scatterings.unwrap_or(1).min(1),
            Method::Photon | Method::Path => settings.max_scatterings.unwrap_or(u32::MAX),
        };
        let chromatic = medium.is_chromatic() && channels == 3;
        why.push(
            "channels",
            if channels == 1 {
                "1 (grey)".into()
            } else {
                format!("3, {}", if chromatic { "spectral MIS" } else { "one walk" })
            },
            if chromatic {
                "extinction differs between channels: each flight is weighted over all three".into()
            } else {
                "equal extinction in all channels: one walk carries all weights".into()
            },
        );
        let shoots_scattered = method == Method::Photon && scatters && orders > 0;
        let mut paths = None;
        let lights: Vec<LightPlan> = if method == Method::Path {
            let (lights, connections) = scene
                .lights
                .iter()
                .map(|light| path::plan_light(scene, settings, light))
                .collect::<Result<(Vec<_>, Vec<_>)>>()?;
            for (light, how) in scene.lights.iter().zip(&connections) {
                why.connection(light, how);
            }
            paths = Some(path::plan(scene, settings, connections, &mut why));
            lights
        } else {
            let plan = |light| lights::plan_light(scene, light, depth, (shoots_scattered, settings.image));
            let lights: Vec<_> = scene.lights.iter().map(plan).collect();
            for (light, plan) in scene.lights.iter().zip(&lights) {
                why.light(light, plan, depth);
            }
            lights
        };
        let refusal = tracker::refuses_lanes(scene, settings, method, chromatic);
        let (tracker, majorant) = tracker::choose_tracker(scene, settings, chromatic, refusal.is_none(), &mut why)?;
        let refusal = refusal.or((tracker == Tracker::March).then_some("the march goes voxel by voxel"));
        let lanes = refusal.is_none();
        let walk = if lanes { "in lanes" } else { "one by one" };
        why.push("walk", walk.into(), refusal.unwrap_or("photons take the same steps").into());
        let least_depth = match tracker {
            Tracker::Woodcock if !lanes && (settings.fluence || settings.radiance) => {
                majorant::least_scored_depth(scene, settings, orders)
            }
            _ => None,
        };
        least_depth.iter().for_each(|&depth| why.scores(depth));
        let score = match tracker {
            Tracker::Woodcock => Score::Collisions,
            Tracker::March => Score::Track,
            Tracker::Analytic => {
                let h = volume.spacing().into_iter().fold(0.0, f64::max);
                if medium.max_sigma_t() * h >= 0.3 { Score::Collisions } else { Score::Track }
            }
        };
        if !volume.is_constant() && tracker == Tracker::Analytic {
            return scene_error("tracker = \"analytic\" needs a homogeneous volume; this one is not constant");
        }

        let emits = medium.emission.as_ref().is_some_and(|glow| glow.power(volume).iter().any(|&power| power > 0.0));
        let emits_photons = emits && method != Method::Path;
        let shooting = lights.iter().filter(|l| l.emission != Emission::Nothing).count() + usize::from(emits_photons);
        let shoots = shooting > 0;
        if let Some(glow) = &medium.emission {
            why.emission(glow, emits, method);
        }
        let (harmonics, truncation) = match method {
            Method::Path => (None, None),
            _ => angular::choose(scene, settings, target_error, &mut why),
        };
        let (mut layers, routes) = match method {
            Method::Path => (Vec::new(), [(None, None); 3]),
            _ => layers::choose(scene, settings, (&lights, emits), shoots_scattered, orders, harmonics.is_some()),
        };
        let uneven = settings.fluence && medium.absorbs_unevenly();
        let absorbed = (uneven && routes.iter().any(|route| route.0.is_some())).then_some(layers.len());
        layers.extend(absorbed.map(|_| Layer::Absorbed));
        if uneven {
            why.push(
                "absorbed",
                "found by itself".into(),
                "the absorption coefficient varies within voxels: its mean with the light is not the product of means"
                    .into(),
            );
        }
        let harmonics = harmonics
            .filter(|_| layers.iter().any(|layer| matches!(layer, Layer::Harmonics | Layer::HarmonicsUnscattered)));
        let photons_per_second =
            cost::photons_per_second(scene, orders, tracker, majorant.as_ref(), lanes, settings.threads);
        let values = volume.voxels() * channels * harmonics.map_or(1, count);
        let subvolumes = match (settings.errors && shoots && settings.image, values) {
            (false, _) => 0,
            (true, 0..=1_048_576) => 16,
            (true, _) => 8,
        };
        let (batch_photons, batches) = if shoots {
            batches::choose(settings, shooting as u64, volume.voxels(), subvolumes, photons_per_second)?
        } else {
            (0, Some(0))
        };
        let sampled = settings.photons.unwrap_or(0);
        if shoots {
            why.push(
                "photons",
                match batches {
                    Some(b) => format!("{sampled} in {b} batches"),
                    None => format!("batches of {batch_photons}"),
                },
                match (settings.photons, target_error, settings.time_limit) {
                    (Some(n), ..) => format!("photons = {n} asked for"),
                    (None, Some(e), _) => format!("until the relative error is below {e}"),
                    (None, None, t) => format!("until {} s have passed", t.unwrap_or(0.0)),
                },
            );
        } else if paths.is_none() {
            why.push("photons", "none".into(), "orders 0 and 1 are found without".into());
        }
        why.push(
            "errors",
            if subvolumes > 0 {
                format!("{subvolumes} replicate volumes")
            } else if paths.is_some() {
                "pixel by pixel".into()
            } else {
                "no pixel errors".into()
            },
            if paths.is_some() {
                "every view ray is an independent estimate".into()
            } else if subvolumes > 0 {
                format!("pixel z follows Student's t with {} degrees of freedom", subvolumes - 1)
            } else if shoots {
                "errors=False, or no image is asked for".into()
            } else {
                "nothing here is sampled".into()
            },
        );
        let mut plan = Plan {
            scene,
            settings: settings.clone(),
            method,
            tracker,
            channels,
            chromatic,
            lanes,
            orders,
            majorant,
            score,
            least_depth,
            lights,
            layers,
            harmonics,
            routes,
            absorbed,
            paths,
            batch_photons,
            batches,
            subvolumes,
            target_error,
            dense,
            seconds: 0.0,
            photons_per_second,
            memory: Memory::default(),
            decisions: Vec::new(),
            warnings: Vec::new(),
        };
        plan.memory = cost::memory(&plan);
        plan.seconds = cost::seconds(&plan);
        plan.decisions = why.decisions;
        if depth > 1e5 {
            plan.warnings.push(format!(
                "a voxel's optical depth reaches {depth:.1e}: beyond 1e5 positions in single precision no longer resolve \
                 the free path, and the light that such voxels reflect is uncertain"
            ));
        }
        if let Some(depth) = plan.dense.filter(|_| !settings.errors) {
            plan.warnings.push(format!(
                "the voxels that are seen are {depth:.1} mean free paths thick, which biases the picture; with \
                 errors=False nothing tells by how much. method = \"path\", outputs = (\"image\",) has no such bias"
            ));
        }
        plan.warnings.extend(truncation.filter(|_| plan.width() > 1));
        cost::check_memory(&plan)?;
        cost::check_adapter(&plan)?;
        Ok(plan)
    }

    /// Photons of batch `batch`: a given number is dealt out evenly, the first batches holding the rest.
    pub fn photons_of(&self, batch: u64) -> u64 {
        match (self.settings.photons, self.batches) {
            (Some(photons), Some(batches)) if batches > 0 => photons / batches + u64::from(batch < photons % batches),
            _ => self.batch_photons,
        }
    }

    /// Scattering order after which a photon's next collision is its last.
    pub fn walked_orders(&self) -> u32 {
        if self.method == Method::Single { 0 } else { self.orders }
    }

    /// Whether anything is sampled by photons.
    pub fn shoots(&self) -> bool {
        self.batch_photons > 0
    }

    /// Whether photons tally the light that is not scattered yet: that of the sky, and of the medium itself.
    pub fn tallies_unscattered(&self) -> bool {
        let sampled = |l: &LightPlan| l.direct == Direct::Sampled && l.emission == Emission::AtLight;
        self.scene.medium.emission.is_some() || self.lights.iter().any(sampled)
    }

    /// Whether fluence and in-scattered radiance differ by 1 / (4 pi) only, so that one set of moments serves both.
    pub fn one_moment(&self) -> bool {
        self.scene.medium.phase.is_isotropic() && self.orders == u32::MAX
    }

    /// Numbers of a layer per voxel and channel.
    pub fn width_of(&self, layer: Layer) -> usize {
        match (layer, self.harmonics) {
            (Layer::Harmonics | Layer::HarmonicsUnscattered, Some(order)) => count(order),
            _ => 1,
        }
    }

    /// Numbers per voxel and channel that the source of images is kept in.
    pub fn width(&self) -> usize {
        self.layers.iter().map(|&layer| self.width_of(layer)).max().unwrap_or(1)
    }

    /// Volumes that batches are summed up in: the replicates, or one where nothing else keeps the source.
    pub fn sums(&self) -> usize {
        self.subvolumes.max(usize::from(self.width() > 1))
    }

    /// Whether means and variances of voxels are kept; images alone need no more than the replicates' sums.
    pub fn keeps_moments(&self) -> bool {
        self.settings.fluence || self.settings.radiance || self.subvolumes == 0
    }

    /// Whether what is absorbed in voxels is found by itself, for it is not the fluence times a coefficient.
    pub fn finds_absorbed(&self) -> bool {
        self.settings.fluence && self.scene.medium.absorbs_unevenly()
    }

    /// The absorption coefficient of the densest voxel by channel [1/length], in multiples of which absorption is tallied;
    /// an albedo per voxel counts as 0.
    pub fn largest_absorption(&self) -> [f64; 3] {
        let medium = &self.scene.medium;
        let coalbedo = match medium.albedo {
            Albedo::Constant(a) => a.rgb.map(|a| 1.0 - a),
            Albedo::PerVoxel(_) => [1.0; 3],
        };
        std::array::from_fn(|c| medium.extinction.rgb[c] * f64::from(medium.volume.max()) * coalbedo[c])
    }

    /// Whether a target error is meant for pixels, not for voxels.
    pub fn over_pixels(&self) -> bool {
        self.subvolumes > 0 && !(self.settings.over_voxels && self.settings.fluence)
    }

    /// Whether the run looks at the error of the fluence while it goes on, for which it needs that of unscattered light.
    pub fn judges_fluence(&self) -> bool {
        let looks = self.target_error.is_some() && self.batches.is_none();
        looks && self.settings.fluence && !self.over_pixels()
    }

    /// Whether in-scattered radiance is estimated (for images or the voxels' radiance).
    pub fn wants_source(&self) -> bool {
        self.orders > 0 && (self.settings.radiance || self.settings.image)
    }
}

/// The largest optical depth that a voxel can have along an axis.
fn voxel_depth(scene: &Scene) -> f64 {
    let volume = &scene.medium.volume;
    let h = volume.spacing().into_iter().fold(0.0, f64::max);
    scene.medium.max_sigma_t() * h
}
