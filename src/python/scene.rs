//! A scene that lives in Rust as long as its result: parsed once, with what was found out about it.

use super::convert::Held;
use crate::backend::cpu::light::{Fine, Illumination};
use crate::error::{Error, Result};
use crate::scene::field::Occupancy;
use crate::scene::{Scene, Voxels};
use numpy::{PyArray3, PyArray4};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::OnceLock;

/// A parsed scene. It holds the arrays of the dictionary that it was parsed from, which must not change.
#[pyclass(frozen, module = "mcrt._mcrt", name = "Scene")]
pub struct Prepared {
    density: Py<PyArray3<f32>>,
    albedo: Option<Py<PyArray3<f32>>>,
    emission: Option<Py<PyArray4<f32>>>,
    /// Everything but the voxels.
    scene: Scene<'static>,
    occupancy: OnceLock<Option<Occupancy>>,
    /// By light, once a picture needed it.
    fine: Vec<OnceLock<Fine>>,
}

#[pymethods]
impl Prepared {
    /// Parses a scene; raises `SceneError` if it is not valid.
    #[new]
    fn new(scene: &Bound<'_, PyDict>) -> PyResult<Self> {
        let held = Held::new(scene)?;
        let parsed = held.scene(scene)?;
        Ok(Prepared {
            scene: parsed.holding(&Voxels::default()),
            occupancy: OnceLock::new(),
            fine: parsed.lights.iter().map(|_| OnceLock::new()).collect(),
            density: (*held.density).clone().unbind(),
            albedo: held.albedo.as_ref().map(|values| (**values).clone().unbind()),
            emission: held.emission.as_ref().map(|values| (**values).clone().unbind()),
        })
    }
}

impl Prepared {
    /// Borrows the arrays.
    pub fn hold<'py>(&self, py: Python<'py>) -> PyResult<Held<'py>> {
        Held::of(
            self.density.bind(py),
            self.albedo.as_ref().map(|values| values.bind(py)),
            self.emission.as_ref().map(|values| values.bind(py)),
        )
    }

    /// The scene, while its arrays are borrowed.
    pub fn scene<'a>(&self, held: &'a Held) -> PyResult<Scene<'a>> {
        Ok(self.scene.holding(&held.voxels()?))
    }

    /// Which parts of it hold anything.
    pub fn occupancy(&self, scene: &Scene) -> Option<&Occupancy> {
        // Not `get_or_init`, whose lock a process forked meanwhile would wait for.
        if self.occupancy.get().is_none() {
            drop(self.occupancy.set(Occupancy::new(&scene.medium.volume)));
        }
        self.occupancy.get().and_then(Option::as_ref)
    }

    /// The finer nodes of a light.
    pub fn fine(&self, light: usize, view: &Illumination, stop: &(impl Fn() -> bool + Sync)) -> Result<&Fine> {
        let kept = &self.fine[light];
        if kept.get().is_none() {
            let found = Fine::new(view, stop);
            if stop() {
                return Err(Error::Interrupted);
            }
            drop(kept.set(found));
        }
        kept.get().ok_or(Error::Interrupted)
    }
}
