//! An open adapter: buffers, textures and dispatches, each of which either succeeds or says why not.

use super::adapter;
use super::kernel::{Binding, Kernel, Source};
use crate::error::{Error, Result};
use bytemuck::{NoUninit, Pod};
use pollster::block_on;
use std::any::Any;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Invocations of a workgroup.
pub const GROUP: u32 = 64;
/// Workgroups along one dimension of a dispatch: all adapters allow these.
const MOST_GROUPS: u32 = 65_535;

/// An open adapter.
#[derive(Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// What the adapter is.
    pub description: adapter::Description,
    /// Whether a processor plays the GPU.
    pub software: bool,
    /// What went wrong outside of any call: the loss of the device, or an error.
    trouble: Arc<Mutex<Option<Error>>>,
    kernels: Mutex<Kernels>,
    /// What was uploaded last to be kept, with its key.
    uploaded: Mutex<Option<(Key, Upload)>>,
}

/// Whose upload it is, and which kind of it.
type Key = (u64, usize);
type Upload = Arc<dyn Any + Send + Sync>;

/// Kernels that are kept.
const KEPT: usize = 64;

/// Compiled kernels.
#[derive(Debug, Default)]
struct Kernels {
    /// The one that was asked for last at the end.
    kept: Vec<(Source, Arc<Kernel>)>,
    /// What sources come to ([`Source::reduced`]).
    known: HashMap<Source, Source>,
    /// How many were compiled.
    compiled: usize,
}

impl Kernels {
    fn find(&mut self, source: &Source) -> Option<Arc<Kernel>> {
        let at = self.kept.iter().position(|(one, _)| one == source)?;
        self.kept[at..].rotate_left(1);
        self.kept.last().map(|(_, kernel)| kernel.clone())
    }

    fn keep(&mut self, source: Source, kernel: Arc<Kernel>) {
        self.compiled += 1;
        if self.kept.len() == KEPT {
            let (gone, _) = self.kept.remove(0);
            self.known.retain(|_, known| *known != gone);
        }
        self.kept.push((source, kernel));
    }
}

/// The open adapters by the wish that they met.
static OPEN: Mutex<Option<HashMap<String, Arc<Gpu>>>> = Mutex::new(None);

/// What a lock holds, whoever panicked with it.
fn held<T>(lock: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The error of an adapter whose memory is used up.
fn no_memory(name: &str) -> Error {
    Error::VolumeTooLarge(format!("the GPU {name} has no memory left; use backend=\"cpu\""))
}

impl Gpu {
    /// The adapter that `wish` means ([`adapter::choose`]); it stays open, and its kernels compiled.
    pub fn open(wish: &str) -> Result<Arc<Gpu>> {
        adapter::own()?;
        let mut open = held(&OPEN);
        let open = open.get_or_insert_with(HashMap::new);
        if let Some(gpu) = open.get(wish).filter(|gpu| held(&gpu.trouble).is_none()) {
            return Ok(gpu.clone());
        }
        let gpu = Arc::new(Gpu::new(&adapter::choose(wish)?)?);
        open.insert(wish.to_string(), gpu.clone());
        Ok(gpu)
    }

    /// The fastest adapter that is no processor, if there is one. It is looked for once.
    pub fn real() -> Option<Arc<Gpu>> {
        static FOUND: OnceLock<bool> = OnceLock::new();
        if adapter::own().is_ok()
            && *FOUND.get_or_init(|| adapter::choose("").is_ok_and(|found| !adapter::is_software(&found)))
        {
            Gpu::open("").ok()
        } else {
            None
        }
    }

    /// Opens an adapter with all that it allows.
    pub fn new(adapter: &wgpu::Adapter) -> Result<Self> {
        let description = adapter::describe(adapter);
        let wishes = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = block_on(adapter.request_device(&wishes)).map_err(|e| {
            Error::NoAdapter(format!("{} could not be opened: {e}; use backend=\"cpu\"", description.name))
        })?;
        let trouble = Arc::new(Mutex::new(None));
        let (lost, failed) = (trouble.clone(), trouble.clone());
        let name = description.name.clone();
        device.set_device_lost_callback(move |reason, message| {
            *held(&lost) = Some(Error::DeviceLost(format!("the GPU {name} was lost ({reason:?}): {message}")));
        });
        let name = description.name.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let error = match error {
                wgpu::Error::OutOfMemory { .. } => no_memory(&name),
                other => Error::Internal(format!("the GPU {name}: {other}")),
            };
            held(&failed).get_or_insert(error);
        }));
        let software = adapter::is_software(adapter);
        Ok(Gpu { device, queue, description, software, trouble, kernels: Mutex::default(), uploaded: Mutex::default() })
    }

    /// Gives the device up, as a driver does that crashes.
    pub fn lose(&self) {
        self.device.destroy();
        held(&self.trouble)
            .get_or_insert_with(|| Error::DeviceLost(format!("the GPU {} was lost", self.description.name)));
    }

    /// Makes a call fail: one that is not valid, or one for which there is no memory.
    pub fn fail(&self, out_of_memory: bool) {
        if out_of_memory {
            held(&self.trouble).get_or_insert_with(|| no_memory(&self.description.name));
        } else {
            let usage = wgpu::BufferUsages::empty();
            let buffer = wgpu::BufferDescriptor { label: None, size: 16, usage, mapped_at_creation: false };
            drop(self.device.create_buffer(&buffer));
        }
    }

    /// An error if something went wrong since the device was opened.
    fn check(&self) -> Result<()> {
        match &*held(&self.trouble) {
            Some(error) => Err(error.clone()),
            None => Ok(()),
        }
    }

    /// The largest buffer that a kernel may see at once [bytes].
    pub fn binding(&self) -> u64 {
        self.description.binding.min(self.description.buffer) & !15
    }

    /// A kernel, compiled when it is first asked for; those asked for last are kept.
    pub fn kernel(&self, source: Source) -> Result<Arc<Kernel>> {
        let mut kernels = held(&self.kernels);
        let reduced = match kernels.known.get(&source) {
            Some(known) => known.clone(),
            None => source.clone().reduced()?,
        };
        let found = kernels.find(&reduced);
        kernels.known.insert(source, reduced.clone());
        drop(kernels);
        if let Some(kernel) = found {
            return Ok(kernel);
        }
        let kernel = Arc::new(Kernel::new(&self.device, &reduced)?);
        self.check()?;
        held(&self.kernels).keep(reduced, kernel.clone());
        Ok(kernel)
    }

    /// Kernels that were compiled since the device was opened, and those of them that are kept.
    pub fn compiled(&self) -> (usize, usize) {
        let kernels = held(&self.kernels);
        (kernels.compiled, kernels.kept.len())
    }

    /// What `upload` makes, which is kept until another key is asked for.
    pub fn kept<T: Any + Send + Sync>(&self, key: Key, upload: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let mut last = held(&self.uploaded);
        let same = last.as_ref().filter(|(of, _)| *of == key);
        if let Some(found) = same.and_then(|(_, upload)| upload.clone().downcast().ok()) {
            return Ok(found);
        }
        // What is kept of another makes room first.
        *last = None;
        let made = Arc::new(upload()?);
        *last = Some((key, made.clone()));
        Ok(made)
    }

    /// A buffer that kernels read and write, of the given size in bytes, all zero.
    pub fn empty(&self, bytes: u64) -> Result<wgpu::Buffer> {
        if bytes > self.binding() {
            return Err(Error::VolumeTooLarge(format!(
                "a buffer of {bytes} bytes is needed, and the GPU {} allows {}; use backend=\"cpu\"",
                self.description.name,
                self.binding()
            )));
        }
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let size = bytes.max(16).next_multiple_of(16);
        let buffer =
            self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
        self.check()?;
        Ok(buffer)
    }

    /// A buffer that kernels read and write, with what it begins with.
    pub fn buffer<T: NoUninit>(&self, values: &[T]) -> Result<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let buffer = self.empty(bytes.len() as u64)?;
        self.write(&buffer, 0, values);
        Ok(buffer)
    }

    /// A buffer of constants.
    pub fn uniform<T: NoUninit>(&self, value: &T) -> Result<wgpu::Buffer> {
        let bytes = bytemuck::bytes_of(value);
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let size = bytes.len().next_multiple_of(16) as u64;
        let buffer =
            self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
        self.check()?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// Writes values into a buffer from the byte `offset` on (a multiple of 4, as the values' size is).
    pub fn write<T: NoUninit>(&self, buffer: &wgpu::Buffer, offset: u64, values: &[T]) {
        self.queue.write_buffer(buffer, offset, bytemuck::cast_slice(values));
    }

    /// Sets a buffer to zero.
    pub fn clear(&self, buffer: &wgpu::Buffer) {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(buffer, 0, None);
        self.queue.submit([encoder.finish()]);
    }

    /// A 3D texture of the given texels, x fastest.
    pub fn texture(&self, n: [usize; 3], format: wgpu::TextureFormat, texels: &[u8]) -> Result<wgpu::TextureView> {
        let most = self.description.extent;
        if n.iter().any(|&m| m > most as usize) {
            return Err(Error::VolumeTooLarge(format!(
                "the volume's shape (nz, ny, nx) = ({}, {}, {}) is too large for the GPU {}, which allows {most} along \
                 each axis; use backend=\"cpu\"",
                n[2], n[1], n[0], self.description.name
            )));
        }
        let size = wgpu::Extent3d { width: n[0] as u32, height: n[1] as u32, depth_or_array_layers: n[2] as u32 };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        self.check()?;
        let row = texels.len() / (n[1] * n[2]);
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row as u32),
            rows_per_image: Some(n[1] as u32),
        };
        self.queue.write_texture(texture.as_image_copy(), texels, layout, size);
        Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
    }

    /// Runs a kernel on `count` invocations at least (its first line turns away those that are too many), and waits for it.
    pub fn run(&self, kernel: &Kernel, bindings: &[(&str, Binding)], count: u64) -> Result<()> {
        let group = kernel.bind(&self.device, bindings)?;
        let groups = count.div_ceil(u64::from(GROUP)).max(1);
        let across = groups.min(u64::from(MOST_GROUPS)) as u32;
        let down = groups.div_ceil(u64::from(across)) as u32;
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&kernel.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(across, down, 1);
        }
        self.queue.submit([encoder.finish()]);
        self.wait()
    }

    /// Waits until all work is done.
    pub fn wait(&self) -> Result<()> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        waited
            .map(|_| ())
            .map_err(|e| Error::DeviceLost(format!("the GPU {} does not answer: {e}", self.description.name)))
    }

    /// The first `count` values of a buffer.
    pub fn read<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>> {
        let size = (count * size_of::<T>()) as u64;
        if size == 0 {
            return Ok(Vec::new());
        }
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let copy = size.next_multiple_of(4);
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: copy,
            usage,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, copy);
        self.queue.submit([encoder.finish()]);
        let lost = |e: String| Error::DeviceLost(format!("the GPU {} was lost: {e}", self.description.name));
        staging.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait()?;
        let view = staging.get_mapped_range(..).map_err(|e| lost(e.to_string()))?;
        let bytes = &view[..size as usize];
        Ok(match bytemuck::try_cast_slice(bytes) {
            Ok(values) => values.to_vec(),
            // Bytes need not lie as the values do.
            Err(_) => bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect(),
        })
    }
}

/// The adapter of tests. Where there is none they are skipped, loudly, or fail if `MCRT_REQUIRE_GPU` is set.
#[cfg(test)]
pub fn for_tests() -> Option<Arc<Gpu>> {
    match Gpu::open("") {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var("MCRT_REQUIRE_GPU").is_ok_and(|value| !value.is_empty()) => panic!("{error}"),
        Err(error) => {
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_asked_for_last_are_kept() {
        let Some(gpu) = for_tests() else { return };
        let gpu = Gpu::new(&adapter::choose(&gpu.description.name).expect("an adapter")).expect("it opens");
        let kernel = |number: usize| {
            let text = format!(
                "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
                 @compute @workgroup_size(64) fn main() {{ out[0] = {number}u; }}"
            );
            gpu.kernel(Source::new([]).rewritten("number", text)).expect("it compiles")
        };
        let first = kernel(0);
        for number in 1..KEPT + 3 {
            kernel(number);
            assert!(Arc::ptr_eq(&first, &kernel(0)));
        }
        assert_eq!(gpu.compiled(), (KEPT + 3, KEPT));
        kernel(1);
        assert_eq!(gpu.compiled(), (KEPT + 4, KEPT));
    }

    #[test]
    fn what_a_kernel_does_not_hold_makes_no_other_kernel() {
        let plain = Source::new(["angular", "eye", "harmonics"]);
        let more = Source::new(["angular", "harmonics", "phase_hg", "eye"]).with("PART", 7u32);
        assert_eq!(plain.reduced(), more.reduced());
    }
}
