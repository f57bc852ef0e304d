//! Errors as exceptions.

use crate::error::Error;
use pyo3::prelude::*;

/// The exception of an error: its class is defined in `mcrt._errors`.
pub fn to_py(py: Python<'_>, error: Error) -> PyErr {
    let class = match &error {
        Error::Scene(_) => "SceneError",
        Error::VolumeTooLarge(_) => "VolumeTooLargeError",
        Error::NoAdapter(_) => "NoAdapterError",
        Error::DeviceLost(_) => "DeviceLostError",
        Error::Interrupted | Error::Internal(_) => "McrtError",
    };
    match py.import("mcrt._errors").and_then(|m| m.getattr(class)).and_then(|c| c.call1((error.to_string(),))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}
