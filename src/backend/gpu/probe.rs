//! Every formula of the shaders on tables of inputs, against its Rust twin: a driver that miscompiles one is told, and named.

mod formulas;
mod voxels;

use super::device::Gpu;
use super::kernel::Binding;
use super::scene::GpuScene;
use super::sources;
use crate::error::Result;
use crate::physics::rng::{uniform, words};
use bytemuck::{Pod, Zeroable};

/// How far a shader function is from what it should return.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// The file in `shaders/`, without its ending.
    pub file: &'static str,
    /// The function.
    pub function: &'static str,
    /// What it is compared with: "f32", the same operations on the CPU, or "f64".
    pub against: &'static str,
    /// Numbers compared.
    pub cases: usize,
    /// The largest error, in units of the last place of what it is relative to; of integers, their difference.
    pub worst: f64,
    /// The error that rounding explains.
    pub bound: f64,
}

impl Probe {
    /// Whether rounding explains all errors.
    pub fn agrees(&self) -> bool {
        self.worst <= self.bound
    }
}

/// `Inputs` of `shaders/probe.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "each function takes them as it needs them")]
pub struct Inputs {
    pub a: [f32; 4],
    pub b: [f32; 4],
    pub w: [u32; 4],
}

impl Inputs {
    /// The first three of `a`.
    fn p(&self) -> [f32; 3] {
        [self.a[0], self.a[1], self.a[2]]
    }

    /// The first three of `b`.
    fn v(&self) -> [f32; 3] {
        [self.b[0], self.b[1], self.b[2]]
    }
}

/// A number, and the size that its error is relative to.
type Measured = (f64, f64);

/// Numbers whose errors are relative to themselves.
fn relative<T: Into<f64>, const N: usize>(numbers: [T; N]) -> [Measured; N] {
    about(f64::from(f32::MIN_POSITIVE), numbers)
}

/// Numbers whose errors are relative to themselves or to a size, whichever is larger.
fn about<T: Into<f64>, const N: usize>(size: f64, numbers: [T; N]) -> [Measured; N] {
    numbers.map(|number| {
        let number: f64 = number.into();
        (number, number.abs().max(size))
    })
}

/// What a function should return for some inputs.
type Answer<'a> = Box<dyn Fn(&Inputs) -> Vec<Measured> + 'a>;

/// What a function should return, how that is known, and how close it should be.
struct Reference<'a> {
    against: &'static str,
    bound: f64,
    answer: Answer<'a>,
}

/// A shader function, its inputs, and what it should return.
struct Twin<'a> {
    file: &'static str,
    function: &'static str,
    /// Statements that call it on `a`, `b: vec4<f32>` and `w: vec4<u32>` and return four numbers of the type.
    body: String,
    of: &'static str,
    inputs: Vec<Inputs>,
    references: Vec<Reference<'a>>,
}

impl<'a> Twin<'a> {
    /// A function of floats; its references follow.
    fn new(file: &'static str, function: &'static str, body: impl Into<String>, inputs: Vec<Inputs>) -> Self {
        Twin { file, function, body: body.into(), of: "f32", inputs, references: Vec::new() }
    }

    /// A function of integers, which must be exact.
    fn words<const N: usize>(
        file: &'static str,
        function: &'static str,
        body: impl Into<String>,
        inputs: Vec<Inputs>,
        answer: impl Fn(&Inputs) -> [u32; N] + 'a,
    ) -> Self {
        let answer = move |i: &Inputs| answer(i).map(|word| (f64::from(word), 1.0 / f64::from(f32::EPSILON)));
        Twin { of: "u32", ..Twin::new(file, function, body, inputs) }.reference("f32", 0.0, answer)
    }

    /// What the same operations give on the CPU. The bound counts the roundings that a GPU may do otherwise: any product
    /// may be fused into a sum, a quotient is right to 2.5 units, a root to 4.5.
    fn single<const N: usize>(self, bound: f64, answer: impl Fn(&Inputs) -> [Measured; N] + 'a) -> Self {
        self.reference("f32", bound, answer)
    }

    /// The truth.
    fn double<const N: usize>(self, bound: f64, answer: impl Fn(&Inputs) -> [Measured; N] + 'a) -> Self {
        self.reference("f64", bound, answer)
    }

    fn reference<const N: usize>(
        mut self,
        against: &'static str,
        bound: f64,
        answer: impl Fn(&Inputs) -> [Measured; N] + 'a,
    ) -> Self {
        self.references.push(Reference { against, bound, answer: Box::new(move |i| answer(i).to_vec()) });
        self
    }

    /// The largest error against a reference of what the GPU returned, and how many numbers that is.
    fn compare(&self, reference: &Reference, found: &[[u32; 4]]) -> Probe {
        let (mut worst, mut cases) = (0.0f64, 0);
        for (inputs, found) in self.inputs.iter().zip(found) {
            for ((value, size), bits) in (reference.answer)(inputs).into_iter().zip(found) {
                let found = if self.of == "f32" { f64::from(f32::from_bits(*bits)) } else { f64::from(*bits) };
                let error = (found - value).abs() / (f64::from(f32::EPSILON) * size);
                worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
                cases += 1;
            }
        }
        let Twin { file, function, .. } = *self;
        Probe { file, function, against: reference.against, cases, worst, bound: reference.bound }
    }
}

/// What runs probes: an adapter, and what changes the text of its shaders.
struct Bench<'a> {
    gpu: &'a Gpu,
    alter: &'a dyn Fn(String) -> String,
    found: Vec<Probe>,
}

impl Bench<'_> {
    /// Compares functions in a scene; `files` and `more` are those that are not of the scene.
    fn run(
        &mut self,
        scene: &GpuScene,
        files: &[&'static str],
        more: &[(&str, Binding)],
        twins: &[Twin],
    ) -> Result<()> {
        for twin in twins {
            let gpu = self.gpu;
            let source = scene.source(&[&["probe"], files].concat());
            let call = format!(
                "fn call(a: vec4<f32>, b: vec4<f32>, w: vec4<u32>) -> vec4<{}> {{\n    {}\n}}\n",
                twin.of, twin.body
            );
            let text = (self.alter)(source.around(sources::read("probe")? + "\n" + &call)?);
            let kernel = gpu.kernel(source.rewritten(twin.function, text))?;
            let (inputs, outputs) = (gpu.buffer(&twin.inputs)?, gpu.empty(twin.inputs.len() as u64 * 16)?);
            let mut bindings = scene.bindings();
            bindings.extend_from_slice(more);
            bindings.extend([("inputs", Binding::Buffer(&inputs)), ("outputs", Binding::Buffer(&outputs))]);
            gpu.run(&kernel, &bindings, twin.inputs.len() as u64)?;
            let found = gpu.read(&outputs, twin.inputs.len())?;
            for reference in &twin.references {
                self.keep(twin.compare(reference, &found));
            }
        }
        Ok(())
    }

    /// Several scenes may probe one function.
    fn keep(&mut self, probe: Probe) {
        let same =
            |one: &&mut Probe| (one.file, one.function, one.against) == (probe.file, probe.function, probe.against);
        match self.found.iter_mut().find(same) {
            Some(one) => {
                one.cases += probe.cases;
                one.worst = one.worst.max(probe.worst);
                one.bound = one.bound.max(probe.bound);
            }
            None => self.found.push(probe),
        }
    }
}

/// Compares every formula on an adapter with its Rust twin.
pub fn run(gpu: &Gpu) -> Result<Vec<Probe>> {
    run_altered(gpu, &|text| text)
}

/// The same with shaders that were changed.
pub fn run_altered(gpu: &Gpu, alter: &dyn Fn(String) -> String) -> Result<Vec<Probe>> {
    let mut bench = Bench { gpu, alter, found: Vec::new() };
    voxels::run(&mut bench)?;
    Ok(bench.found)
}

/// Inputs of one number each.
fn numbers(numbers: impl IntoIterator<Item = f32>) -> Vec<Inputs> {
    numbers.into_iter().map(|x| Inputs { a: [x, 0.0, 0.0, 0.0], ..Inputs::default() }).collect()
}

/// Words at both ends, around those that floats hold exactly, and random ones.
fn some_words() -> Vec<u32> {
    let ends = [0, 1, 2, 3, 0xffff, 0x1_0000, u32::MAX - 1, u32::MAX];
    let around = (24..32).flat_map(|b| [(1 << b) - 1, 1 << b, (1 << b) + 1, (1 << b) + 3]);
    let random = (0..256).flat_map(|i| words([5, 0], [i, 0], 0, 99));
    ends.into_iter().chain(around).chain(random).collect()
}

/// Inputs made of random numbers: eight in (0, 1], and four words.
fn drawn(count: u32, of: impl Fn([f32; 8], [u32; 4]) -> Inputs) -> Vec<Inputs> {
    (0..count)
        .map(|i| {
            let word = |k: usize| words([6, 0], [i, 0], (k / 4) as u32, 99)[k % 4];
            of(std::array::from_fn(|k| uniform(word(k))), std::array::from_fn(|k| word(8 + k)))
        })
        .collect()
}

/// Unit vectors: the poles from both sides, along the other axes, close to the poles, and random ones.
fn directions() -> Vec<[f32; 3]> {
    let near = 1e-4f32;
    let mut all = vec![
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, -0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, -0.0],
        [near, 0.0, (1.0 - near * near).sqrt()],
        [0.0, -near, -(1.0 - near * near).sqrt()],
        [0.6, 0.8, 1e-20],
        [0.6, -0.8, -1e-20],
    ];
    all.extend(
        drawn(200, |u, _| {
            let [x, y, z] = crate::physics::frame::sphere(u[0], u[1]);
            Inputs { a: [x, y, z, 0.0], ..Inputs::default() }
        })
        .iter()
        .map(Inputs::p),
    );
    all
}
