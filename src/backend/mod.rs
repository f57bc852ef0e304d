//! What runs a plan: the CPU, or a GPU.

pub mod bias;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod run;
pub mod shot;
pub mod single;
pub mod views;

use crate::error::{Result, scene_error};
use crate::plan::{Adapter, Settings};
use crate::scene::Camera;
use cpu::angular::Towards;
use cpu::gather::{Image, Volumes};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Where the heavy stages of a plan run.
#[derive(Debug, Clone, Default)]
pub enum Device {
    /// On all cores.
    #[default]
    Cpu,
    /// On an adapter.
    #[cfg(feature = "gpu")]
    Gpu(Arc<gpu::Gpu>),
}

impl Device {
    /// What a plan must know of it: the adapter, or `None` for the CPU.
    pub fn adapter(&self) -> Option<Adapter> {
        match self {
            Device::Cpu => None,
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => Some(Adapter {
                name: gpu.description.name.clone(),
                software: gpu.software,
                binding: gpu.binding(),
                extent: gpu.description.extent,
            }),
        }
    }

    /// The device that `wish` means: "cpu"; "gpu", which takes any adapter, the fastest kind first; "gpu:NAME", one with this
    /// in its name, or "gpu:low" and "gpu:high" by its power; "auto" takes an adapter that is no processor, or else the CPU.
    pub fn open(wish: &str) -> Result<Self> {
        match wish.split_once(':').unwrap_or((wish, "")) {
            ("cpu", "") => Ok(Device::Cpu),
            #[cfg(feature = "gpu")]
            ("auto", "") => Ok(gpu::Gpu::real().map_or(Device::Cpu, Device::Gpu)),
            #[cfg(feature = "gpu")]
            ("gpu", name) => gpu::Gpu::open(name).map(Device::Gpu),
            #[cfg(not(feature = "gpu"))]
            ("auto", "") => Ok(Device::Cpu),
            #[cfg(not(feature = "gpu"))]
            ("gpu", _) => {
                Err(crate::error::Error::NoAdapter("this build has no GPU backend; use backend=\"cpu\"".into()))
            }
            _ => scene_error(format!(
                "backend = {wish:?} is not allowed; \"auto\", \"cpu\", \"gpu\" and \"gpu:NAME\" are"
            )),
        }
    }

    /// Whether GPUs are refused, for this process was forked from one that looked for them.
    fn is_inherited() -> bool {
        #[cfg(feature = "gpu")]
        return gpu::adapter::own().is_err();
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Gives an adapter up, as a driver does that crashes.
    pub fn lose(&self) {
        match self {
            Device::Cpu => {}
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.lose(),
        }
    }

    /// Makes a call fail on an adapter: one that is not valid, or one for which there is no memory.
    pub fn fail(&self, out_of_memory: bool) {
        match self {
            Device::Cpu => {}
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.fail(out_of_memory),
        }
    }

    /// An image from what a run left in the voxels ([`cpu::gather::image`]).
    pub fn image(
        &self,
        volumes: &Volumes,
        camera: &Camera,
        pixels: Option<&[usize]>,
        stride: usize,
        whole: bool,
        stop: &(impl Fn() -> bool + Sync),
    ) -> Result<Image> {
        match self {
            Device::Cpu => Ok(cpu::gather::image(volumes, camera, pixels, stride, whole, stop)),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu::gather::image(gpu, volumes, camera, pixels, stride, whole, stop),
        }
    }

    /// J of every voxel from its harmonics ([`Towards::contract`]).
    pub fn contract(&self, towards: &Towards, harmonics: &[f32], inner: usize) -> Result<Vec<f32>> {
        match self {
            Device::Cpu => Ok(towards.contract(harmonics, inner)),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu::angular::contract(gpu, towards, harmonics, inner),
        }
    }
}

impl Settings {
    /// The same settings on the device that was opened for `wish`.
    pub fn on(self, device: &Device, wish: &str) -> Self {
        let chosen = match (wish, device) {
            ("auto", Device::Cpu) if Device::is_inherited() => {
                "the GPU is left to the process that this one was forked from"
            }
            ("auto", Device::Cpu) => "no GPU was found (a software adapter is taken only if asked for)",
            #[cfg(feature = "gpu")]
            ("auto", Device::Gpu(_)) => "a GPU was found",
            _ => "asked for",
        };
        Settings { adapter: device.adapter(), chosen, ..self }
    }
}

/// How a run is watched and stopped from outside while it works.
#[derive(Debug)]
pub struct Control {
    stop: Arc<AtomicBool>,
    finish: Arc<AtomicBool>,
    fraction: AtomicU64,
    photons: AtomicU64,
    started: Instant,
    deadline: Option<Duration>,
}

impl Control {
    /// A run that starts now and stops at the latest after `limit` seconds.
    pub fn new(limit: Option<f64>) -> Self {
        Control {
            stop: Arc::default(),
            finish: Arc::default(),
            fraction: AtomicU64::new(0),
            photons: AtomicU64::new(0),
            started: Instant::now(),
            deadline: limit.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)),
        }
    }

    /// A part of this run that reports to nobody: it stops and ends with the run, and takes at most this share of the time
    /// that is left.
    pub fn part(&self, share: f64) -> Self {
        let left = self.deadline.map(|limit| limit.saturating_sub(self.started.elapsed()).mul_f64(share).as_secs_f64());
        Control { stop: self.stop.clone(), finish: self.finish.clone(), ..Control::new(left) }
    }

    /// Asks the run to end with what it has, as its time limit does.
    pub fn finish(&self) {
        self.finish.store(true, Relaxed);
    }

    /// Whether it was asked to end with what it has.
    pub fn finishing(&self) -> bool {
        self.finish.load(Relaxed)
    }

    /// Asks the run to stop at once, for nobody waits for its result.
    pub fn stop(&self) {
        self.stop.store(true, Relaxed);
    }

    /// Whether it was asked to stop.
    pub fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// Whether it is time to end with what there is.
    pub fn late(&self) -> bool {
        self.finishing() || self.deadline.is_some_and(|d| self.started.elapsed() >= d)
    }

    /// The part of its time that has passed; 0 without a limit.
    pub fn time_fraction(&self) -> f64 {
        self.deadline.map_or(0.0, |d| (self.started.elapsed().as_secs_f64() / d.as_secs_f64()).min(1.0))
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Says how far the run is; it never goes back.
    pub fn report(&self, fraction: f64, photons: u64) {
        // Bits of non-negative floats have their order.
        self.fraction.fetch_max(fraction.max(0.0).to_bits(), Relaxed);
        self.photons.store(photons, Relaxed);
    }

    /// (fraction done, photons so far).
    pub fn progress(&self) -> (f64, u64) {
        (f64::from_bits(self.fraction.load(Relaxed)), self.photons.load(Relaxed))
    }
}
