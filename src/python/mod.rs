//! The Python module `mcrt._mcrt`: dictionaries and arrays in, arrays out. The only place that knows of Python.

mod convert;
mod errors;
mod machine;
mod scene;
mod watch;

use crate::backend::Device;
use crate::backend::cpu::angular::Towards;
use crate::backend::cpu::gather::{Volumes, beams, samples};
use crate::backend::cpu::light::{Fine, Illumination};
use crate::backend::cpu::pixel_error;
use crate::backend::run;
use crate::error::Error;
use crate::error::Result;
use crate::physics::Phase;
use crate::physics::harmonics::count;
use crate::physics::rng::{Draws, split, uniform64};
use crate::plan::{Column, Direct, LightPlan, Plan, Settings, cost};
use crate::result::{Order0, Outcome, Stopped};
use crate::scene::{Camera, Light};
use convert::array;
use errors::to_py;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use scene::Prepared;
use watch::Threads;

/// The Rust core of mcrt.
#[pymodule]
mod _mcrt {
    #[pymodule_export]
    use super::machine::{info, kernels, probe};
    #[pymodule_export]
    use super::scene::Prepared;
    #[pymodule_export]
    use super::{
        Unfinished, check_camera, check_light, check_phase, default_lights, fail_device, framing_camera, gather,
        lose_device, phase_eval, phase_sample, plan, simulate, unscattered,
    };
}

/// Raises `SceneError` if the light is not valid.
#[pyfunction]
fn check_light(spec: &Bound<'_, PyAny>) -> PyResult<()> {
    convert::light(spec, &Threads::new(None)).map(drop)
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
    scene: &Bound<'py, Prepared>,
    settings: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyDict>> {
    let (device, wish) = device(py, settings)?;
    let held = scene.get().hold(py)?;
    let (scene, settings) = (scene.get().scene(&held)?, convert::settings(settings)?.on(&device, &wish));
    let threads = Threads::new(settings.threads);
    let plan = threads.run(py, || Plan::new(&scene, &settings))?;
    describe(py, &plan)
}

/// A run that an error cut short, to go on from.
#[pyclass(frozen, module = "mcrt._mcrt")]
struct Unfinished(run::Unfinished);

/// Where a plan is to run.
fn device(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<(Device, String)> {
    let wish = convert::optional::<String>(settings, "backend")?.unwrap_or_else(|| "auto".into());
    let device = py.detach(|| Device::open(&wish)).map_err(|e| to_py(py, e))?;
    Ok((device, wish))
}

/// Runs a plan, or goes on with a run of it that was cut short. If this is cut short too, the dictionary has the entries
/// "cut_short", the exception, and "unfinished", to go on from.
#[pyfunction]
#[pyo3(signature = (scene, settings, progress, before=None))]
fn simulate<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Prepared>,
    settings: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
    before: Option<&Bound<'py, Unfinished>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (device, wish) = device(py, settings)?;
    let held = scene.get().hold(py)?;
    let (scene, settings) = (scene.get().scene(&held)?, convert::settings(settings)?.on(&device, &wish));
    let threads = Threads::new(settings.threads);
    let plan = threads.run(py, || Plan::new(&scene, &settings))?;
    let before = before.map(|before| before.get().0.clone());
    let (outcome, unfinished) = threads
        .watch(py, settings.time_limit, progress.as_ref(), |control| run::run(&plan, &device, control, before))?;
    let out = report(py, &plan, outcome)?;
    if let Some(unfinished) = unfinished {
        out.set_item("cut_short", to_py(py, unfinished.why.clone()))?;
        out.set_item("unfinished", Bound::new(py, Unfinished(unfinished))?)?;
    }
    Ok(out)
}

/// Gives up the device that a backend means, as a driver does that crashes: what runs on it is lost.
#[pyfunction]
fn lose_device(py: Python<'_>, backend: &str) -> PyResult<()> {
    py.detach(|| Device::open(backend).map(|device| device.lose())).map_err(|e| to_py(py, e))
}

/// Makes a call fail on the device that a backend means: one that is not valid, or one for which there is no memory.
#[pyfunction]
fn fail_device(py: Python<'_>, backend: &str, out_of_memory: bool) -> PyResult<()> {
    py.detach(|| Device::open(backend).map(|device| device.fail(out_of_memory))).map_err(|e| to_py(py, e))
}

/// What unscattered light adds to the arrays that a run left.
#[pyfunction]
fn unscattered<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Prepared>,
    settings: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyDict>> {
    let scene = scene.get();
    let held = scene.hold(py)?;
    let parsed = scene.scene(&held)?;
    // The run that this belongs to was let through; its unscattered light is found on the CPU, whatever it ran on.
    let settings = Settings { force: true, ..convert::settings(settings)?.on(&Device::Cpu, "cpu") };
    let (order0, channels) = Threads::new(settings.threads).watch(py, None, None, |control| {
        let plan = Plan::new(&parsed, &settings)?;
        Ok((run::order0(&plan, control)?, plan.channels))
    })?;
    report_order0(py, order0, parsed.medium.volume.n(), channels)
}

/// Where what a run left is looked at: where there is no GPU, a result that was loaded is shown too.
fn device_or_cpu(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<Device> {
    let wish = convert::optional::<String>(settings, "backend")?.unwrap_or_else(|| "cpu".into());
    match py.detach(|| Device::open(&wish)) {
        Err(Error::NoAdapter(_)) => Ok(Device::Cpu),
        device => device.map_err(|e| to_py(py, e)),
    }
}

/// Order 0 as a dictionary of arrays.
fn report_order0<'py>(py: Python<'py>, order0: Order0, n: [usize; 3], channels: usize) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let shape = [n[2], n[1], n[0]];
    for (name, pair) in [("fluence", order0.fluence), ("radiance", order0.radiance), ("absorbed", order0.absorbed)] {
        if let Some((mean, error)) = pair {
            out.set_item(name, array(py, mean, &shape, channels, 1)?)?;
            out.set_item(format!("{name}_error"), array(py, error, &shape, channels, 1)?)?;
        }
    }
    Ok(out)
}

/// Images from what a run left in the voxels; the standard error alone if it is the replicates' turn.
#[pyfunction]
fn gather<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Prepared>,
    volumes: &Bound<'py, PyDict>,
    camera: &Bound<'py, PyAny>,
    replicates: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let scene = scene.get();
    let held = scene.hold(py)?;
    let parsed = scene.scene(&held)?;
    let camera = convert::camera(camera)?;
    let stored = convert::Stored::new(volumes, &parsed)?;
    let threads = Threads::new(convert::optional(volumes, "threads")?);
    let channels = parsed.channels();
    if stored.harmonics.is_none()
        && !parsed.medium.phase.is_isotropic()
        && (stored.source.is_some() || stored.source0.is_some())
    {
        convert::same_eye(py, &camera, &stored.eye)?;
    }
    let device = device_or_cpu(py, volumes)?;
    let k = if replicates { stored.replicates() } else { 0 };
    let pixels = camera.resolution[0] * camera.resolution[1];
    let numbers = if replicates { channels * (k + 1) } else { channels * 6 };
    cost::check_image(pixels as u64, numbers as u64).map_err(|e| to_py(py, e))?;
    // Without a scattering no light is seen in the medium; and paths have seen it already.
    let dark = convert::optional::<u64>(volumes, "max_scatterings")? == Some(0)
        || convert::optional::<bool>(volumes, "transmitted_only")? == Some(true);
    let columns: Vec<_> = stored.columns.iter().map(|c| c.as_ref().map(|c| c.slice())).collect();
    let [source, source0, subvolumes] =
        [&stored.source, &stored.source0, &stored.subvolumes].map(|s| s.as_ref().map(|s| s.slice()));
    let (harmonics, fine) = (stored.harmonics, &stored.fine);
    let shape = [camera.resolution[1], camera.resolution[0]];
    let out = PyDict::new(py);
    if replicates {
        // What is found without photons has no noise: it is left out.
        let Some(subvolumes) = subvolumes else { return Ok(out) };
        let error = threads.watch(py, None, None, |control| {
            let stop = || control.stopped();
            let seen = harmonics
                .map(|order| device.contract(&Towards::new(&parsed, &camera, order), subvolumes, channels * k));
            let seen = seen.transpose()?;
            let volumes = Volumes {
                scene: &parsed,
                occupancy: scene.occupancy(&parsed),
                lights: Vec::new(),
                source: Some(seen.as_deref().unwrap_or(subvolumes)),
                source0: None,
                channels,
            };
            let picture = device.image(&volumes, &camera, None, channels * k, false, &stop)?;
            Ok(pixel_error::spread(&picture.order2, k).1)
        })?;
        out.set_item("error", array(py, error, &shape, channels, 1)?)?;
        return Ok(out);
    }
    let picture = threads.watch(py, None, None, |control| {
        let stop = || control.stopped();
        let occupancy = scene.occupancy(&parsed);
        let samples = samples(&parsed, &camera, pixels);
        let view = |(at, light): (usize, &Light)| {
            let column = if columns[at].is_some() { Column::Grid } else { Column::Rays };
            let view = Illumination::new(&parsed, occupancy, light, column, columns[at])?;
            let fine = fine[at] && matches!(device, Device::Cpu) && Fine::pays(&view, samples);
            Some(if fine { scene.fine(at, &view, &stop).map(|fine| view.between(fine)) } else { Ok(view) })
        };
        let lights = parsed.lights.iter().enumerate().filter(|_| !dark).filter_map(view).collect::<Result<_>>()?;
        let toward = harmonics.map(|order| Towards::new(&parsed, &camera, order));
        let seen = |values: Option<&'_ [f32]>| match (&toward, values) {
            (Some(toward), Some(values)) => device.contract(toward, values, channels).map(Some),
            _ => Ok(None),
        };
        let (own, own0) = (seen(source)?, seen(source0)?);
        let mut source0 = own0.or_else(|| source0.map(<[f32]>::to_vec));
        if let Some(beams) = beams(&parsed, &camera, channels).filter(|_| !dark) {
            match &mut source0 {
                Some(all) => all.iter_mut().zip(&beams).for_each(|(a, b)| *a += b),
                None => source0 = Some(beams),
            }
        }
        let source = own.as_deref().or(source);
        let volumes = Volumes { scene: &parsed, occupancy, lights, source, source0: source0.as_deref(), channels };
        device.image(&volumes, &camera, None, channels, true, &stop)
    })?;
    for (name, layer) in [
        ("background", picture.background),
        ("emitted", picture.emitted),
        ("order1", picture.order1),
        ("order2", picture.order2),
        ("transmittance", picture.transmittance),
    ] {
        out.set_item(name, array(py, layer, &shape, channels, 1)?)?;
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
    let voxels = [("fluence", outcome.fluence), ("radiance", outcome.radiance), ("absorbed", outcome.absorbed)];
    for (name, pair) in voxels {
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
    out.set_item("fine", plan.lights.iter().map(LightPlan::fine).collect::<Vec<_>>())?;
    if plan.paths.is_none() {
        out.set_item("energy", convert::energy(py, &outcome.energy, channels)?)?;
        let voxels = plan.settings.fluence || plan.settings.radiance;
        out.set_item("order0", !voxels || plan.lights.iter().all(|light| light.direct == Direct::Sampled))?;
    }
    if let Some(order0) = outcome.order0 {
        out.set_item("unscattered", report_order0(py, order0, n, channels)?)?;
    }
    let stats = PyDict::new(py);
    stats.set_item("photons", outcome.photons)?;
    stats.set_item("collisions", outcome.collisions)?;
    stats.set_item("batches", outcome.batches)?;
    stats.set_item("degrees_of_freedom", outcome.degrees_of_freedom)?;
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
        Stopped::Error => "error",
    };
    stats.set_item("stopped_by", stopped)?;
    out.set_item("stats", stats)?;
    out.set_item("warnings", outcome.warnings)?;
    Ok(out)
}
