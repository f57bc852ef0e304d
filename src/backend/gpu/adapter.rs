//! Which adapter runs kernels: all that there are, and the one that is meant.

use crate::error::{Error, Result};
use pollster::block_on;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// What an adapter says of itself.
#[derive(Debug, Clone)]
pub struct Description {
    /// Its name.
    pub name: String,
    /// What kind of device it is: "discrete", "integrated", "virtual", "software" or "other".
    pub kind: &'static str,
    /// The interface that it is reached through, and its driver.
    pub driver: String,
    /// The largest buffer that a kernel may see at once [bytes].
    pub binding: u64,
    /// The largest buffer [bytes].
    pub buffer: u64,
    /// The largest extent of a volume along an axis [voxels].
    pub extent: u32,
}

/// The kinds in the order in which they are preferred.
const KINDS: [(wgpu::DeviceType, &str); 5] = [
    (wgpu::DeviceType::DiscreteGpu, "discrete"),
    (wgpu::DeviceType::IntegratedGpu, "integrated"),
    (wgpu::DeviceType::VirtualGpu, "virtual"),
    (wgpu::DeviceType::Other, "other"),
    (wgpu::DeviceType::Cpu, "software"),
];

/// The place of an adapter among the kinds.
fn rank(adapter: &wgpu::Adapter) -> usize {
    let kind = adapter.get_info().device_type;
    KINDS.iter().position(|(one, _)| *one == kind).unwrap_or(KINDS.len() - 1)
}

/// Whether an adapter is a processor that plays a GPU.
pub fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == wgpu::DeviceType::Cpu
}

/// What an adapter is.
pub fn describe(adapter: &wgpu::Adapter) -> Description {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    Description {
        name: info.name,
        kind: KINDS[rank(adapter)].1,
        driver: [info.backend.to_string(), info.driver, info.driver_info].join(" ").trim().to_string(),
        binding: limits.max_storage_buffer_binding_size,
        buffer: limits.max_buffer_size,
        extent: limits.max_texture_dimension_3d,
    }
}

/// The process that looked for adapters first, or 0.
static OWNER: AtomicU32 = AtomicU32::new(0);

/// Makes this process the one that uses drivers. A fork of one that did is refused: it lacks the threads of the drivers,
/// and whatever another thread had locked, it finds locked for ever.
pub fn own() -> Result<()> {
    let this = std::process::id();
    match OWNER.compare_exchange(0, this, Relaxed, Relaxed) {
        Err(owner) if owner != this => Err(Error::NoAdapter(format!(
            "this process is a fork of process {owner}, which used the GPU or looked for one, and a driver works only in \
             the process that loaded it; start processes by \"spawn\" or \"forkserver\", as \
             multiprocessing.get_context(\"spawn\") does, or use backend=\"cpu\""
        ))),
        _ => Ok(()),
    }
}

/// All adapters that can run kernels, the fastest kind first.
pub fn all() -> Result<Vec<wgpu::Adapter>> {
    own()?;
    let mut options = wgpu::InstanceDescriptor::new_without_display_handle();
    options.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    let instance = wgpu::Instance::new(options);
    let mut found = block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    found.retain(|adapter| adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS));
    found.sort_by_key(rank);
    Ok(found)
}

/// What all adapters say of themselves, the fastest kind first.
pub fn descriptions() -> Result<Vec<Description>> {
    Ok(all()?.iter().map(describe).collect())
}

/// The adapter that `wish` means: "high" (or nothing) is the fastest kind, "low" an integrated one before all others, and
/// anything else a part of a name, in either case of letters.
pub fn choose(wish: &str) -> Result<wgpu::Adapter> {
    let mut found = all()?;
    let names: Vec<String> = found.iter().map(|adapter| adapter.get_info().name).collect();
    let at = match wish.to_lowercase().as_str() {
        "" | "high" => found.first().map(|_| 0),
        "low" => found
            .iter()
            .position(|a| a.get_info().device_type == wgpu::DeviceType::IntegratedGpu)
            .or(found.first().map(|_| 0)),
        wish => names.iter().position(|name| name.to_lowercase().contains(wish)),
    };
    match at {
        Some(at) => Ok(found.swap_remove(at)),
        None if names.is_empty() => Err(Error::NoAdapter(
            "no GPU adapter was found; install a driver for Vulkan, Metal or DirectX 12 (on Debian and Ubuntu \
             mesa-vulkan-drivers holds those of AMD and Intel, and one that runs on any processor), or use \
             backend=\"cpu\""
                .into(),
        )),
        None => Err(Error::NoAdapter(format!(
            "no GPU adapter is named {wish:?}; there are {}; or use backend=\"cpu\"",
            names.join(", ")
        ))),
    }
}
