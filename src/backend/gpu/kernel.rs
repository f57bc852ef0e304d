//! Kernels: shader files joined, their constants set, their resources bound by name.

use super::sources;
use crate::error::{Error, Result};
use std::collections::{BTreeMap, HashSet};

/// What a kernel is made of: it is compiled once for each.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Source {
    /// Names of files in `shaders/`, without their ending; the first one holds the entry point `main`.
    files: Vec<&'static str>,
    /// Values of `override` constants, as the bits of doubles.
    constants: BTreeMap<&'static str, u64>,
    /// The text, where it is not that of the files.
    text: Option<String>,
}

impl Source {
    /// The kernel of a file, with the files that it calls on.
    pub fn new(files: impl IntoIterator<Item = &'static str>) -> Self {
        let mut list = Vec::new();
        for file in files {
            if !list.contains(&file) {
                list.push(file);
            }
        }
        Source { files: list, constants: BTreeMap::new(), text: None }
    }

    /// Names of its files.
    pub fn files(&self) -> &[&'static str] {
        &self.files
    }

    /// Leaves a file out.
    pub fn without(mut self, file: &str) -> Self {
        self.files.retain(|one| *one != file);
        self
    }

    /// Sets a constant.
    pub fn with(mut self, name: &'static str, value: impl Into<f64>) -> Self {
        self.constants.insert(name, value.into().to_bits());
        self
    }

    /// The kernel of a text of its own, of the same constants.
    pub fn rewritten(self, name: &'static str, text: String) -> Self {
        Source { files: vec![name], text: Some(text), ..self }
    }

    /// The WGSL of the first file and of those that it calls on, and so on: what a kernel does not use is left out.
    pub fn text(&self) -> Result<String> {
        match (&self.text, self.files.first()) {
            (Some(text), _) => Ok(text.clone()),
            (None, first) => self.around(first.map_or(Ok(String::new()), |file| sources::read(file))?),
        }
    }

    /// A text with those of the other files that it calls on, and so on.
    pub fn around(&self, text: String) -> Result<String> {
        Ok(self.joined(text)?.1)
    }

    /// The files that a text calls on, and so on, and the text with theirs.
    fn joined(&self, mut text: String) -> Result<(Vec<&'static str>, String)> {
        let read = |file: &&'static str| -> Result<(&'static str, String)> { Ok((*file, sources::read(file)?)) };
        let mut rest = self.files.iter().skip(1).map(read).collect::<Result<Vec<_>>>()?;
        let mut mentioned: HashSet<String> = words(&text).map(str::to_string).collect();
        let mut used = Vec::new();
        while let Some(at) = rest.iter().position(|(_, file)| declared(file).any(|name| mentioned.contains(name))) {
            let (name, file) = rest.remove(at);
            mentioned.extend(words(&file).map(str::to_string));
            used.push(name);
            text.push('\n');
            text += &file;
        }
        Ok((used, text))
    }

    /// What it comes to: without files that nothing calls on, and without constants that no file declares.
    pub fn reduced(mut self) -> Result<Self> {
        let text = match (&self.text, self.files.first()) {
            (None, Some(first)) => {
                let (mut used, text) = self.joined(sources::read(first)?)?;
                used.sort_unstable();
                self.files.truncate(1);
                self.files.extend(used);
                text
            }
            (text, _) => text.clone().unwrap_or_default(),
        };
        let names: HashSet<&str> = declared(&text).collect();
        self.constants.retain(|name, _| names.contains(name));
        Ok(self)
    }
}

/// The names that a file declares at its top level.
fn declared(file: &str) -> impl Iterator<Item = &str> {
    file.lines().filter_map(|line| {
        // Attributes and address spaces stand before the word that says what it is, or behind it.
        let line = line.rsplit_once(") ").filter(|_| line.starts_with("@group")).map_or(line, |(_, rest)| rest);
        let (word, rest) = line.split_once(' ')?;
        let kind = word.split('<').next()?;
        let declares = ["fn", "struct", "const", "override", "alias", "var"].contains(&kind);
        let rest = if word.contains('<') && !word.contains('>') { rest.split_once("> ")?.1 } else { rest };
        declares.then(|| rest.split(|c| !is_part(c)).next().unwrap_or_default())
    })
}

/// Whether a character is part of a name.
fn is_part(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The words of a text outside of its comments.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let code = text.lines().map(|line| line.split_once("//").map_or(line, |(code, _)| code));
    code.flat_map(|code| code.split(|c| !is_part(c)))
}

/// Something that a kernel reads or writes.
#[derive(Debug, Clone, Copy)]
pub enum Binding<'a> {
    /// All of a buffer.
    Buffer(&'a wgpu::Buffer),
    /// A texture.
    Texture(&'a wgpu::TextureView),
}

/// A compiled kernel.
#[derive(Debug)]
pub struct Kernel {
    /// For [`super::Gpu::run`].
    pub(super) pipeline: wgpu::ComputePipeline,
    /// Names of the resources that it uses, and their numbers.
    resources: Vec<(String, u32)>,
    name: &'static str,
}

/// A module and what was found out about it.
pub fn parse(source: &Source) -> Result<(naga::Module, naga::valid::ModuleInfo)> {
    let text = source.text()?;
    let fail = |what: String| Error::Internal(format!("the shader {:?} is not valid: {what}", source.files));
    let module = naga::front::wgsl::parse_str(&text).map_err(|e| fail(e.emit_to_string(&text)))?;
    let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
        .validate(&module)
        .map_err(|e| fail(e.emit_to_string(&text)))?;
    Ok((module, info))
}

/// Bytes of a struct of a kernel, if it has that.
#[cfg(test)]
pub fn span(source: &Source, name: &str) -> Option<u64> {
    let (module, _) = parse(source).expect("it is valid");
    module.types.iter().find_map(|(_, kind)| match kind.inner {
        naga::TypeInner::Struct { span, .. } if kind.name.as_deref() == Some(name) => Some(u64::from(span)),
        _ => None,
    })
}

impl Kernel {
    /// Compiles a kernel, which sets no constants but those it declares ([`Source::reduced`]).
    pub fn new(device: &wgpu::Device, source: &Source) -> Result<Self> {
        let (module, info) = parse(source)?;
        let used = info.get_entry_point(0);
        let mut resources = Vec::new();
        for (handle, global) in module.global_variables.iter() {
            if let (Some(binding), Some(name), false) = (&global.binding, &global.name, used[handle].is_empty()) {
                resources.push((name.clone(), binding.binding));
            }
        }
        let constants: Vec<(&str, f64)> =
            source.constants.iter().map(|(name, bits)| (*name, f64::from_bits(*bits))).collect();
        let name = source.files.first().copied().unwrap_or_default();
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(source.text()?.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &shader,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            cache: None,
        });
        Ok(Kernel { pipeline, resources, name })
    }

    /// Binds what the kernel uses among the given resources.
    pub(super) fn bind(&self, device: &wgpu::Device, bindings: &[(&str, Binding)]) -> Result<wgpu::BindGroup> {
        let mut entries = Vec::with_capacity(self.resources.len());
        for (name, number) in &self.resources {
            let Some((_, resource)) = bindings.iter().find(|(given, _)| given == name) else {
                return Err(Error::Internal(format!("the kernel {} was given no {name}", self.name)));
            };
            let resource = match resource {
                Binding::Buffer(buffer) => buffer.as_entire_binding(),
                Binding::Texture(view) => wgpu::BindingResource::TextureView(view),
            };
            entries.push(wgpu::BindGroupEntry { binding: *number, resource });
        }
        let layout = self.pipeline.get_bind_group_layout(0);
        Ok(device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &layout,
            entries: &entries,
        }))
    }
}
