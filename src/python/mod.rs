//! The Python module `mcrt._mcrt`: dictionaries and arrays in, arrays out. The only place that knows of Python.

mod convert;
mod machine;
mod watch;

use crate::backend::Device;
use crate::backend::cpu::angular::Towards;
use crate::backend::cpu::gather::{Volumes, beams};
use crate::backend::cpu::{self, pixel_error};
use crate::backend::run;
use crate::error::Error;
use crate::physics::Phase;
use crate::physics::harmonics::count;
use crate::physics::rng::{Draws, split, uniform64};
use crate::plan::{Column, Plan, cost};
use crate::result::{Outcome, Share, Stopped};
use crate::scene::field::Occupancy;
use crate::scene::{Albedo, Camera};
use convert::{Held, array, to_py};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// The Rust core of mcrt.
#[pymodule]
mod _mcrt {
    #[pymodule_export]
    use super::machine::{info, probe};
    #[pymodule_export]
    use super::{
        Unfinished, check_camera, check_light, check_phase, default_lights, framing_camera, gather, lose_device,
        phase_eval, phase_sample, plan, simulate,
    };
}

/// Raises `SceneError` if the light is not valid.
#[pyfunction]
fn check_light(spec: &Bound<'_, PyAny>) -> PyResult<()> {
    convert::light(spec).map(drop)
}

/// Raises `SceneError` if the phase function is not valid.
#[pyfunction]
fn check_phase(spec: &Bound<'_, PyAny>) -> PyResult<()> {
    convert::phase(spec).map(drop)
}

/// Raises `SceneError` if the camera is not valid.
#[pyfunction]
fn check_camera(spec: &Bound<'_, PyAny>) -> PyResult<()> {
    convert::camera(spec).map(drop)
}

/// The phase function [1/sr] at cosines.
#[pyfunction]
fn phase_eval<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    cos_theta: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let phase = convert::phase(spec)?;
    Ok(PyArray1::from_iter(py, cos_theta.as_array().iter().map(|&c| phase.pdf(c))))
}

/// `n` cosines sampled from the phase function.
#[pyfunction]
fn phase_sample<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    n: u64,
    seed: u64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let phase: Phase = convert::phase(spec)?;
    let draw = |i| phase.sample(uniform64(Draws::new(split(seed), i, 1).next4()[0])).0;
    Ok(PyArray1::from_vec(py, (0..n).map(draw).collect()))
}

/// The spec of the camera that sees the whole box.
#[pyfunction]
fn framing_camera<'py>(
    py: Python<'py>,
    shape: [usize; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
) -> PyResult<Bound<'py, PyAny>> {
    let size = convert::box_size(py, shape, spacing, origin)?;
    let (eye, target, fov) = Camera::framing(origin, size);
    let spec =
        ("perspective", (eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), (0.0, 0.0, 1.0), fov, (600, 600));
    Ok(spec.into_pyobject(py)?.into_any())
}

/// The specs of the lights that a volume gets if none is given: a point up and to the left of the framing camera, of unit
/// irradiance at the volume's centre.
#[pyfunction]
fn default_lights<'py>(
    py: Python<'py>,
    shape: [usize; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
) -> PyResult<Bound<'py, PyAny>> {
    let size = convert::box_size(py, shape, spacing, origin)?;
    let diagonal = size.iter().map(|s| s * s).sum::<f64>().sqrt();
    let way = [-0.62, -0.62, 0.48].map(|c: f64| 1.5 * diagonal * c);
    let p: [f64; 3] = std::array::from_fn(|a| origin[a] + 0.5 * size[a] + way[a]);
    let intensity = way.iter().map(|c| c * c).sum::<f64>();
    Ok(PyList::new(py, [("point", (p[0], p[1], p[2]), (intensity,))])?.into_any())
}

/// What would run, why, at what cost.
#[pyfunction]
fn plan<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyDict>,
    settings: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyDict>> {
    let (device, wish) = device(py, settings)?;
    let held = Held::new(scene)?;
    let (scene, settings) = (held.scene(scene)?, convert::settings(settings)?.on(&device, wish != "auto"));
    let plan = py.detach(|| Plan::new(&scene, &settings)).map_err(|e| to_py(py, e))?;
    describe(py, &plan)
}

/// A run that a lost device cut short, to go on from.
#[pyclass(frozen, module = "mcrt._mcrt")]
struct Unfinished(run::Unfinished);

/// Where a plan is to run.
fn device(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<(Device, String)> {
    let wish = convert::optional::<String>(settings, "backend")?.unwrap_or_else(|| "auto".into());
    let device = py.detach(|| Device::open(&wish)).map_err(|e| to_py(py, e))?;
    Ok((device, wish))
}

/// Runs a plan, or goes on with a run of it that was cut short. If this is cut short too, the dictionary has the entries
/// "lost", what happened, and "unfinished", to go on from.
#[pyfunction]
#[pyo3(signature = (scene, settings, progress, before=None))]
fn simulate<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyDict>,
    settings: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
    before: Option<&Bound<'py, Unfinished>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (device, wish) = device(py, settings)?;
    let held = Held::new(scene)?;
    let (scene, settings) = (held.scene(scene)?, convert::settings(settings)?.on(&device, wish != "auto"));
    let plan = py.detach(|| Plan::new(&scene, &settings)).map_err(|e| to_py(py, e))?;
    let before = before.map(|before| before.get().0.clone());
    let (outcome, unfinished) =
        watch::run(py, settings.time_limit, progress.as_ref(), |control| run::run(&plan, &device, control, before))?;
    let out = report(py, &plan, outcome)?;
    if let Some(unfinished) = unfinished {
        out.set_item("lost", unfinished.why.to_string())?;
        out.set_item("unfinished", Bound::new(py, Unfinished(unfinished))?)?;
    }
    Ok(out)
}

/// Gives up the device that a backend means, as a driver does that crashes: what runs on it is lost.
#[pyfunction]
fn lose_device(py: Python<'_>, backend: &str) -> PyResult<()> {
    py.detach(|| Device::open(backend).map(|device| device.lose())).map_err(|e| to_py(py, e))
}

/// Images from what a run left in the voxels.
#[pyfunction]
fn gather<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyDict>,
    volumes: &Bound<'py, PyDict>,
    camera: &Bound<'py, PyAny>,
    replicates: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let held = Held::new(scene)?;
    let parsed = held.scene(scene)?;
    let camera = convert::camera(camera)?;
    let stored = convert::Stored::new(volumes, &parsed)?;
    let threads: Option<usize> = convert::optional(volumes, "threads")?;
    let channels = parsed.channels();
    if stored.harmonics.is_none()
        && !parsed.medium.phase.is_isotropic()
        && (stored.source.is_some() || stored.source0.is_some())
    {
        convert::same_eye(py, &camera, &stored.eye)?;
    }
    // A result that was loaded is shown where there is no GPU, too.
    let wish = convert::optional::<String>(volumes, "backend")?.unwrap_or_else(|| "cpu".into());
    let device = match py.detach(|| Device::open(&wish)) {
        Err(Error::NoAdapter(_)) => Device::Cpu,
        device => device.map_err(|e| to_py(py, e))?,
    };
    let k = if replicates { stored.replicates() } else { 0 };
    let pixels = (camera.resolution[0] * camera.resolution[1]) as u64;
    cost::check_image(pixels, (channels * (6 + k)) as u64).map_err(|e| to_py(py, e))?;
    let occupancy = py.detach(|| Occupancy::new(&parsed.medium.volume));
    let occupancy = occupancy.as_ref();
    let columns: Vec<_> =
        stored.columns.iter().map(|c| if c.is_some() { Column::Grid } else { Column::Rays }).collect();
    // Without a scattering no light is seen in the medium; and paths have seen it already.
    let dark = convert::optional::<u64>(volumes, "max_scatterings")? == Some(0)
        || convert::optional::<bool>(volumes, "transmitted_only")? == Some(true);
    let lights = parsed
        .lights
        .iter()
        .filter(|_| !dark)
        .zip(&columns)
        .zip(&stored.columns)
        .filter_map(|((light, how), nodes)| {
            cpu::light::Illumination::new(&parsed, occupancy, light, *how, nodes.as_ref().map(|c| c.slice()))
        })
        .collect();
    let [source, source0] = [&stored.source, &stored.source0].map(|s| s.as_ref().map(|s| s.slice()));
    let subvolumes = stored.subvolumes.as_ref().filter(|_| k > 0).map(|s| s.slice());
    let harmonics = stored.harmonics;
    // What one photon in each voxel would add to an opaque pixel, by channel.
    let mut one_photon = convert::optional::<Vec<f64>>(volumes, "one_photon")?.unwrap_or_default();
    one_photon.resize(channels, 0.0);
    let albedo = match parsed.medium.albedo {
        Albedo::Constant(albedo) => albedo.rgb,
        Albedo::PerVoxel(_) => [parsed.medium.max_albedo(); 3],
    };
    one_photon.iter_mut().zip(albedo).for_each(|(one, albedo)| *one *= albedo);
    let (picture, error, bias) = watch::run(py, None, None, |control| {
        cpu::with_threads(threads, || {
            let stop = || control.stopped();
            let toward = harmonics.map(|order| Towards::new(&parsed, &camera, order));
            let seen = |values: Option<&'_ [f32]>, inner: usize| match (&toward, values) {
                (Some(toward), Some(values)) => device.contract(toward, values, inner).map(Some),
                _ => Ok(None),
            };
            let (own, own0, own_sub) =
                (seen(source, channels)?, seen(source0, channels)?, seen(subvolumes, channels * k)?);
            let source = own.as_deref().or(source);
            let mut source0 = own0.or_else(|| source0.map(<[f32]>::to_vec));
            if let Some(beams) = beams(&parsed, &camera, channels).filter(|_| !dark) {
                match &mut source0 {
                    Some(all) => all.iter_mut().zip(&beams).for_each(|(a, b)| *a += b),
                    None => source0 = Some(beams),
                }
            }
            let volumes = Volumes { scene: &parsed, occupancy, lights, source, source0: source0.as_deref(), channels };
            let picture = device.image(&volumes, &camera, None, channels, true, &stop)?;
            let error = match own_sub.as_deref().or(subvolumes) {
                Some(source) => {
                    let (lights, source) = (Vec::new(), Some(source));
                    let each = Volumes { scene: &parsed, occupancy, lights, source, source0: None, channels };
                    let spread = device.image(&each, &camera, None, channels * k, false, &stop)?.order2;
                    let mut error = pixel_error::spread(&spread, k).1;
                    pixel_error::unreached(&mut error, &spread, k, &picture.transmittance, &one_photon);
                    Some(error)
                }
                None => None,
            };
            let bias = match source.filter(|_| replicates) {
                Some(source) => Some(pixel_error::bias(&device, &volumes, source, &camera, None, &stop)?),
                None => None,
            };
            Ok((picture, error, bias))
        })?
    })?;
    let shape = [camera.resolution[1], camera.resolution[0]];
    let out = PyDict::new(py);
    let empty = vec![0.0; picture.order1.len()];
    out.set_item("background", array(py, picture.background, &shape, channels, 1)?)?;
    out.set_item("emitted", array(py, picture.emitted, &shape, channels, 1)?)?;
    out.set_item("order1", array(py, picture.order1, &shape, channels, 1)?)?;
    out.set_item("order2", array(py, picture.order2, &shape, channels, 1)?)?;
    out.set_item("transmittance", array(py, picture.transmittance, &shape, channels, 1)?)?;
    if let Some(error) = error {
        out.set_item("error", array(py, error, &shape, channels, 1)?)?;
    }
    if replicates {
        out.set_item("bias", array(py, bias.unwrap_or(empty), &shape, channels, 1)?)?;
    }
    Ok(out)
}

/// A plan as a dictionary.
fn describe<'py>(py: Python<'py>, plan: &Plan) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("method", format!("{:?}", plan.method).to_lowercase())?;
    out.set_item("tracker", format!("{:?}", plan.tracker).to_lowercase())?;
    out.set_item("backend", if plan.settings.adapter.is_some() { "gpu" } else { "cpu" })?;
    out.set_item("channels", plan.channels)?;
    let decisions: Vec<_> = plan.decisions.iter().map(|d| (d.name, &d.choice, &d.reason)).collect();
    out.set_item("decisions", decisions)?;
    out.set_item("bytes", plan.memory.total())?;
    let parts = PyDict::new(py);
    for (name, bytes) in &plan.memory.parts {
        parts.set_item(name, bytes)?;
    }
    out.set_item("bytes_by_part", parts)?;
    out.set_item("seconds", plan.seconds)?;
    let photons = plan.settings.photons.filter(|_| plan.shoots());
    let rounds = plan.batches.unwrap_or(plan.subvolumes.max(8) as u64);
    let walks = if plan.paths.is_some() { cost::paths(plan) } else { photons.unwrap_or(plan.batch_photons * rounds) };
    out.set_item("photons", walks)?;
    out.set_item("batches", plan.paths.as_ref().map_or(rounds, |paths| paths.rays.unwrap_or(paths.pass)))?;
    out.set_item("subvolumes", plan.subvolumes)?;
    out.set_item("warnings", &plan.warnings)?;
    Ok(out)
}

/// An outcome as a dictionary of arrays.
fn report<'py>(py: Python<'py>, plan: &Plan, outcome: Outcome) -> PyResult<Bound<'py, PyDict>> {
    let (channels, n) = (plan.channels, plan.scene.medium.volume.n());
    let shape = [n[2], n[1], n[0]];
    let mut by_direction = shape.to_vec();
    by_direction.extend(plan.harmonics.map(count));
    let out = PyDict::new(py);
    let description = describe(py, plan)?;
    description.set_item("photons", outcome.photons)?;
    description.set_item("batches", outcome.batches)?;
    out.set_item("plan", description)?;
    for (name, pair) in [("fluence", outcome.fluence), ("radiance", outcome.radiance)] {
        if let Some((mean, error)) = pair {
            out.set_item(name, array(py, mean, &shape, channels, 1)?)?;
            out.set_item(format!("{name}_error"), array(py, error, &shape, channels, 1)?)?;
        }
    }
    for (name, volume) in [("source", outcome.source), ("source0", outcome.source0)] {
        if let Some(volume) = volume {
            out.set_item(name, array(py, volume, &by_direction, channels, 1)?)?;
        }
    }
    if let Some(pixels) = outcome.pixels {
        let [width, height] = plan.scene.camera.resolution;
        for (name, values) in [("order1", pixels.order1), ("order2", pixels.order2), ("error", pixels.error)] {
            out.set_item(name, array(py, values, &[height, width], channels, 1)?)?;
        }
    }
    out.set_item("harmonics", plan.harmonics)?;
    if let Some(unreached) = outcome.unreached {
        out.set_item("unreached", PyArray1::from_vec(py, unreached).reshape(shape)?)?;
    }
    if plan.shoots() {
        out.set_item("one_photon", PyArray1::from_slice(py, &outcome.one_photon[..channels]))?;
    }
    if let Some(volumes) = outcome.subvolumes {
        out.set_item("subvolumes", array(py, volumes, &by_direction, channels, outcome.replicates)?)?;
    }
    let columns = PyList::empty(py);
    for grid in outcome.columns {
        match grid {
            Some(grid) => columns.append(array(py, grid, &shape.map(|m| m + 2), 1, 1)?)?,
            None => columns.append(py.None())?,
        }
    }
    out.set_item("columns", columns)?;
    if plan.paths.is_none() {
        let energy = PyDict::new(py);
        let by_channel = |values: &[f64; 3]| PyArray1::from_slice(py, &values[..channels]);
        energy.set_item("launched", by_channel(&outcome.energy.launched))?;
        energy.set_item("error", by_channel(&outcome.energy.error))?;
        for (share, name) in Share::ALL {
            energy.set_item(name, by_channel(&outcome.energy.fractions[share.index()]))?;
        }
        out.set_item("energy", energy)?;
    }
    let stats = PyDict::new(py);
    stats.set_item("photons", outcome.photons)?;
    stats.set_item("collisions", outcome.collisions)?;
    stats.set_item("batches", outcome.batches)?;
    stats.set_item("degrees_of_freedom", outcome.batches.saturating_sub(1))?;
    let independent = if plan.paths.is_some() { outcome.batches as usize } else { outcome.replicates };
    stats.set_item("degrees_of_freedom_pixel", independent.saturating_sub(1))?;
    stats.set_item("spp", plan.paths.as_ref().map(|paths| paths.starts * outcome.batches))?;
    let seconds = PyDict::new(py);
    let stages = ["light grid", if plan.paths.is_some() { "paths" } else { "photons" }, "estimate"];
    for (name, value) in stages.into_iter().zip(outcome.seconds) {
        seconds.set_item(name, value)?;
    }
    stats.set_item("seconds", seconds)?;
    let stopped = match outcome.stopped {
        Stopped::Photons if plan.paths.is_some() => "spp",
        Stopped::Photons => "photons",
        Stopped::TargetError => "target_error",
        Stopped::TimeLimit => "time_limit",
        Stopped::Progress => "progress",
        Stopped::DeviceLost => "device lost",
    };
    stats.set_item("stopped_by", stopped)?;
    out.set_item("stats", stats)?;
    out.set_item("warnings", outcome.warnings)?;
    Ok(out)
}
