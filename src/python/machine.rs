//! What there is on this machine.

use super::errors::to_py;
use super::watch::Threads;
use crate::backend::Device;
use crate::backend::cpu::simd;
use crate::plan::cost;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// Version, lanes in use, threads, and the GPU adapters, the fastest kind first; "refusal" says why none are looked for.
#[pyfunction]
pub fn info(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("version", env!("CARGO_PKG_VERSION"))?;
    out.set_item("simd", simd::best().to_string())?;
    out.set_item("threads", cost::threads(None))?;
    let adapters = PyList::empty(py);
    #[cfg(feature = "gpu")]
    match py.detach(crate::backend::gpu::adapter::descriptions) {
        Ok(descriptions) => {
            for description in descriptions {
                let adapter = PyDict::new(py);
                adapter.set_item("name", description.name)?;
                adapter.set_item("kind", description.kind)?;
                adapter.set_item("driver", description.driver)?;
                adapter.set_item("buffer", description.buffer)?;
                adapter.set_item("binding", description.binding)?;
                adapter.set_item("extent", description.extent)?;
                adapters.append(adapter)?;
            }
        }
        Err(refusal) => out.set_item("refusal", refusal.to_string())?,
    }
    out.set_item("adapters", adapters)?;
    Ok(out)
}

/// Kernels that were compiled for a backend since it was opened, and those of them that are kept.
#[pyfunction]
pub fn kernels(py: Python<'_>, backend: &str) -> PyResult<(usize, usize)> {
    match py.detach(|| Device::open(backend)).map_err(|e| to_py(py, e))? {
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => Ok(gpu.compiled()),
        Device::Cpu => Ok((0, 0)),
    }
}

/// Runs every formula of the shaders on the adapter that the backend "gpu" takes: file, function, what it is compared with,
/// cases, the largest error in units of the last place, and the error that rounding explains.
#[pyfunction]
#[expect(clippy::type_complexity, reason = "one row of a table")]
pub fn probe(py: Python<'_>) -> PyResult<Vec<(&'static str, &'static str, &'static str, usize, f64, f64)>> {
    match py.detach(|| Device::open("gpu")).map_err(|e| to_py(py, e))? {
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => {
            let probes = Threads::new(Some(1)).run(py, || crate::backend::gpu::probe::run(&gpu))?;
            Ok(probes.into_iter().map(|p| (p.file, p.function, p.against, p.cases, p.worst, p.bound)).collect())
        }
        Device::Cpu => Ok(Vec::new()),
    }
}
