//! Python values to scenes and settings, arrays back.

use super::errors::to_py;
use super::watch::Threads;
use crate::error::Error;
use crate::physics::Phase;
use crate::plan::{Angular, Settings};
use crate::result::{Energy, Share};
use crate::scene::camera::Eye;
use crate::scene::environment::Map;
use crate::scene::volume::placed;
use crate::scene::{Albedo, Camera, Emission, Light, Medium, Scene, Spectrum, Volume, Voxels};
use numpy::{
    PyArray1, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray3, PyReadonlyArray4, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySequence};

fn scene_error(py: Python<'_>, message: String) -> PyErr {
    to_py(py, Error::Scene(message))
}

fn get<'py>(dict: &Bound<'py, PyDict>, key: &str) -> PyResult<Bound<'py, PyAny>> {
    dict.get_item(key)?.ok_or_else(|| scene_error(dict.py(), format!("{key} is missing")))
}

/// A value, or `None` where the key is absent or None.
pub fn optional<'py, T: for<'a> FromPyObject<'a, 'py>>(dict: &Bound<'py, PyDict>, key: &str) -> PyResult<Option<T>>
where
    for<'a> <T as FromPyObject<'a, 'py>>::Error: Into<PyErr>,
{
    match dict.get_item(key)? {
        Some(value) if !value.is_none() => value.extract().map(Some).map_err(Into::into),
        _ => Ok(None),
    }
}

fn numbers(value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    value.try_iter()?.map(|item| item?.extract::<f64>()).collect()
}

fn point(value: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    let list = numbers(value)?;
    let count = list.len();
    list.try_into().map_err(|_| scene_error(value.py(), format!("{count} coordinates were given; 3 are needed")))
}

/// A light from its spec.
pub fn light(spec: &Bound<'_, PyAny>, threads: &Threads) -> PyResult<Light> {
    let py = spec.py();
    let kind: String = spec.get_item(0)?.extract()?;
    let at = |i: usize| spec.get_item(i);
    match kind.as_str() {
        "point" => Light::point(point(&at(1)?)?, &numbers(&at(2)?)?),
        "pencil" => Light::pencil(point(&at(1)?)?, point(&at(2)?)?, &numbers(&at(3)?)?),
        "directional" => Light::directional(point(&at(1)?)?, &numbers(&at(2)?)?),
        "environment" => match at(1)?.extract::<PyReadonlyArrayDyn<f32>>() {
            Ok(map) => {
                let (shape, texels) = (map.shape(), map.as_slice()?.to_vec());
                let [height, width] = [0, 1].map(|axis| shape.get(axis).copied().unwrap_or(0));
                let channels = shape.get(2).copied().unwrap_or(1);
                let found = || Map::new(texels, width, height, channels).and_then(Light::environment_map);
                return threads.run(py, found);
            }
            Err(_) => Light::environment(&numbers(&at(1)?)?),
        },
        _ => Err(Error::Scene(format!("light {kind:?} is not known"))),
    }
    .map_err(|e| to_py(py, e))
}

/// A phase function from its spec.
pub fn phase(spec: &Bound<'_, PyAny>) -> PyResult<Phase> {
    let py = spec.py();
    let kind: String = spec.get_item(0)?.extract()?;
    match kind.as_str() {
        "isotropic" => Ok(Phase::Isotropic),
        "rayleigh" => Ok(Phase::Rayleigh),
        "hg" => Phase::henyey_greenstein(spec.get_item(1)?.extract()?),
        "tabulated" => Phase::tabulated(&numbers(&spec.get_item(1)?)?, &numbers(&spec.get_item(2)?)?),
        _ => Err(Error::Scene(format!("phase function {kind:?} is not known"))),
    }
    .map_err(|e| to_py(py, e))
}

/// A camera from its spec.
pub fn camera(spec: &Bound<'_, PyAny>) -> PyResult<Camera> {
    let py = spec.py();
    let kind: String = spec.get_item(0)?.extract()?;
    let vector = |i: usize| point(&spec.get_item(i)?);
    let size: f64 = spec.get_item(4)?.extract()?;
    let resolution: [usize; 2] = {
        let value = spec.get_item(5)?;
        [value.get_item(0)?.extract()?, value.get_item(1)?.extract()?]
    };
    match kind.as_str() {
        "perspective" => Camera::perspective(vector(1)?, vector(2)?, vector(3)?, size, resolution),
        "orthographic" => Camera::orthographic(vector(1)?, vector(2)?, vector(3)?, size, resolution),
        _ => Err(Error::Scene(format!("camera {kind:?} is not known"))),
    }
    .map_err(|e| to_py(py, e))
}

/// z, y, x to x, y, z.
fn turned<T: Copy>(zyx: [T; 3]) -> [T; 3] {
    [zyx[2], zyx[1], zyx[0]]
}

/// The size (x, y, z) of a box, its extents and spacing checked.
pub fn box_size(py: Python<'_>, shape: [usize; 3], spacing: [f64; 3], origin: [f64; 3]) -> PyResult<[f64; 3]> {
    if shape.contains(&0) {
        return Err(scene_error(py, format!("the volume's shape {shape:?} has no voxels")));
    }
    placed(turned(spacing), origin).map_err(|e| to_py(py, e))?;
    let (n, h) = (turned(shape), turned(spacing));
    Ok(std::array::from_fn(|a| n[a] as f64 * h[a]))
}

/// The arrays of a scene while they are borrowed.
pub struct Held<'py> {
    /// (z, y, x)
    pub density: PyReadonlyArray3<'py, f32>,
    /// (z, y, x)
    pub albedo: Option<PyReadonlyArray3<'py, f32>>,
    /// (channel, z, y, x)
    pub emission: Option<PyReadonlyArray4<'py, f32>>,
}

impl<'py> Held<'py> {
    /// Borrows the arrays of a scene dictionary.
    pub fn new(scene: &Bound<'py, PyDict>) -> PyResult<Self> {
        let albedo = get(scene, "albedo")?;
        let albedo = albedo.extract::<PyReadonlyArray3<f32>>().ok();
        let emission = match scene.get_item("emission")? {
            Some(values) if !values.is_none() => Some(values.extract::<PyReadonlyArray4<f32>>()?),
            _ => None,
        };
        Ok(Held { density: get(scene, "density")?.extract::<PyReadonlyArray3<f32>>()?, albedo, emission })
    }

    /// Borrows the arrays of a scene.
    pub fn of(
        density: &Bound<'py, PyArray3<f32>>,
        albedo: Option<&Bound<'py, PyArray3<f32>>>,
        emission: Option<&Bound<'py, PyArray4<f32>>>,
    ) -> PyResult<Self> {
        Ok(Held {
            density: density.try_readonly()?,
            albedo: albedo.map(PyArrayMethods::try_readonly).transpose()?,
            emission: emission.map(PyArrayMethods::try_readonly).transpose()?,
        })
    }

    /// What the arrays hold.
    pub fn voxels(&self) -> PyResult<Voxels<'_>> {
        Ok(Voxels {
            density: self.density.as_slice()?,
            albedo: self.albedo.as_ref().map_or(Ok(&[][..]), |values| values.as_slice())?,
            emission: self.emission.as_ref().map_or(Ok(&[][..]), |values| values.as_slice())?,
        })
    }

    /// Parses the scene.
    pub fn scene<'a>(&'a self, dict: &Bound<'py, PyDict>, threads: &Threads) -> PyResult<Scene<'a>> {
        let py = dict.py();
        let fail = |e| to_py(py, e);
        let shape = self.density.shape();
        let spacing: [f64; 3] = point(&get(dict, "spacing")?)?;
        let origin = point(&get(dict, "origin")?)?;
        let linear: bool = get(dict, "linear")?.extract()?;
        let density = self.density.as_slice()?;
        let n = [shape[2], shape[1], shape[0]];
        let volume = threads.run(py, || Volume::new(density, n, turned(spacing), origin, linear))?;
        let ball = optional::<String>(dict, "shape")?.is_some_and(|shape| shape == "sphere");
        let volume = if ball { volume.ball().map_err(fail)? } else { volume };
        let extinction = Spectrum::new(&numbers(&get(dict, "extinction")?)?, "extinction").map_err(fail)?;
        let albedo = match &self.albedo {
            Some(values) => {
                if values.shape() != shape {
                    return Err(scene_error(
                        py,
                        format!(
                            "albedo has the shape {:?} and the volume {shape:?}; they must be equal",
                            values.shape()
                        ),
                    ));
                }
                Albedo::PerVoxel(values.as_slice()?)
            }
            None => Albedo::Constant(Spectrum::new(&numbers(&get(dict, "albedo")?)?, "albedo").map_err(fail)?),
        };
        let medium = Medium::new(volume, extinction, albedo, phase(&get(dict, "phase")?)?).map_err(fail)?;
        let emission = match &self.emission {
            Some(values) => {
                let (shape, values) = (values.shape(), values.as_slice()?);
                Some(threads.run(py, || Emission::new(values, shape[0], &medium.volume))?)
            }
            None => None,
        };
        let medium = medium.emitting(emission);
        let lights = get(dict, "lights")?.try_iter()?.map(|l| light(&l?, threads)).collect::<PyResult<Vec<_>>>()?;
        Ok(Scene::new(medium, lights, camera(&get(dict, "camera")?)?))
    }
}

/// Settings from their dictionary.
pub fn settings(dict: &Bound<'_, PyDict>) -> PyResult<Settings> {
    let py = dict.py();
    let fail = |e| to_py(py, e);
    let choice = |key: &str| -> PyResult<Option<String>> { Ok(optional::<String>(dict, key)?.filter(|s| s != "auto")) };
    let outputs: Vec<String> = get(dict, "outputs")?.try_iter()?.map(|s| s?.extract()).collect::<PyResult<_>>()?;
    let wants = |name: &str| outputs.iter().any(|o| o == name);
    let settings = Settings {
        method: choice("method")?.map(|s| s.parse()).transpose().map_err(fail)?,
        tracker: choice("tracker")?.map(|s| s.parse()).transpose().map_err(fail)?,
        photons: optional(dict, "photons")?,
        spp: optional(dict, "spp")?,
        target_error: optional(dict, "target_error")?,
        time_limit: optional(dict, "time_limit")?,
        // No run reaches more orders than 32 bits count.
        max_scatterings: optional::<u64>(dict, "max_scatterings")?.map(|n| n.min(u64::from(u32::MAX) - 1) as u32),
        seed: get(dict, "seed")?.extract()?,
        threads: optional(dict, "threads")?,
        errors: get(dict, "errors")?.extract()?,
        fluence: wants("fluence"),
        radiance: wants("radiance"),
        image: wants("image"),
        force: get(dict, "force")?.extract()?,
        angular: match get(dict, "angular")?.extract::<Option<i64>>()? {
            None => Angular::Eye,
            Some(order) => Angular::Harmonics(usize::try_from(order).ok()),
        },
        simd: optional::<String>(dict, "simd")?.map(|s| s.parse()).transpose().map_err(fail)?,
        over_voxels: get(dict, "over_voxels")?.extract()?,
        ..Settings::default()
    };
    settings.validate().map_err(fail)?;
    Ok(settings)
}

/// A voxel array borrowed from Python.
pub struct Borrowed<'py>(PyReadonlyArrayDyn<'py, f32>);

impl Borrowed<'_> {
    /// Its values; checked to be contiguous when it was borrowed.
    pub fn slice(&self) -> &[f32] {
        self.0.as_slice().unwrap_or_default()
    }
}

/// What a run left for the gather.
pub struct Stored<'py> {
    /// J of incident orders >= 1.
    pub source: Option<Borrowed<'py>>,
    /// J of incident order 0.
    pub source0: Option<Borrowed<'py>>,
    /// Replicates.
    pub subvolumes: Option<Borrowed<'py>>,
    /// Column densities, one per light.
    pub columns: Vec<Option<Borrowed<'py>>>,
    /// Whether large pictures interpolate columns between finer nodes, by light.
    pub fine: Vec<bool>,
    /// Order of the spherical harmonics that J is given in.
    pub harmonics: Option<usize>,
    /// The camera that the run recorded for.
    pub eye: Camera,
}

impl<'py> Stored<'py> {
    /// Borrows the arrays, and checks that they fit the scene.
    pub fn new(dict: &Bound<'py, PyDict>, scene: &Scene) -> PyResult<Self> {
        let py = dict.py();
        let volume = &scene.medium.volume;
        let values = volume.voxels() * scene.channels();
        let nodes: usize = volume.n().iter().map(|m| m + 2).product();
        let borrow = |value: &Bound<'py, PyAny>, name: &str, fits: &dyn Fn(usize) -> bool| {
            let array = value.extract::<PyReadonlyArrayDyn<f32>>()?;
            if !fits(array.len()) || array.as_slice().is_err() {
                return Err(scene_error(py, format!("{name} does not fit the scene")));
            }
            Ok(Borrowed(array))
        };
        let item = |name: &str, fits: &dyn Fn(usize) -> bool| match dict.get_item(name)? {
            Some(value) if !value.is_none() => borrow(&value, name, fits).map(Some),
            _ => Ok(None),
        };
        let mut columns = Vec::new();
        for column in get(dict, "columns")?.cast::<PySequence>()?.try_iter()? {
            let column = column?;
            columns.push(if column.is_none() { None } else { Some(borrow(&column, "columns", &|len| len == nodes)?) });
        }
        columns.resize_with(scene.lights.len(), || None);
        let mut fine: Vec<bool> = optional(dict, "fine")?.unwrap_or_default();
        fine.resize(scene.lights.len(), false);
        Ok(Stored {
            source: item("source", &|len| len > 0 && len % values == 0)?,
            source0: item("source0", &|len| len > 0 && len % values == 0)?,
            subvolumes: item("subvolumes", &|len| len > 0 && len % values == 0)?,
            harmonics: optional(dict, "harmonics")?,
            columns,
            fine,
            eye: camera(&get(dict, "eye")?)?,
        })
    }

    /// Number of replicates.
    pub fn replicates(&self) -> usize {
        self.subvolumes.as_ref().and_then(|s| s.0.shape().last().copied()).unwrap_or(0)
    }
}

/// An energy balance as a dictionary of arrays (channel).
pub fn energy<'py>(py: Python<'py>, energy: &Energy, channels: usize) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let by_channel = |values: &[f64; 3]| PyArray1::from_slice(py, &values[..channels]);
    out.set_item("launched", by_channel(&energy.launched))?;
    out.set_item("error", by_channel(&energy.error))?;
    out.set_item("unscattered_error", by_channel(&energy.unscattered_error))?;
    out.set_item("absorbed_error", by_channel(&energy.absorbed_error))?;
    out.set_item("imbalance", by_channel(&energy.imbalance))?;
    for (share, name) in Share::ALL {
        out.set_item(name, by_channel(&energy.fractions[share.index()]))?;
    }
    Ok(out)
}

/// Refuses an eye that an anisotropic run was not recorded for.
pub fn same_eye(py: Python<'_>, asked: &Camera, recorded: &Camera) -> PyResult<()> {
    let near = |a: [f64; 3], b: [f64; 3], scale: f64| (0..3).all(|i| (a[i] - b[i]).abs() <= 1e-9 * scale);
    let same = match (asked.eye(), recorded.eye()) {
        (Eye::Point(a), Eye::Point(b)) => near(a, b, b.iter().fold(1.0, |m, c| m.max(c.abs()))),
        (Eye::Direction(a), Eye::Direction(b)) => near(a, b, 1.0),
        _ => false,
    };
    if same {
        return Ok(());
    }
    let name = |eye| match eye {
        Eye::Point(p) => format!("the eye at {p:?}"),
        Eye::Direction(d) => format!("the eye in the direction {d:?}"),
    };
    Err(scene_error(
        py,
        format!(
            "the phase function is not isotropic, so the run was recorded towards {}; {} needs another run with \
             camera=... (other targets, fields of view and resolutions of the same eye are served), or one with \
             angular=\"sh\", which serves all",
            name(recorded.eye()),
            name(asked.eye())
        ),
    ))
}

/// Values as an array of the given shape, with a channel axis if there are 3, and one of replicates if there are several.
pub fn array<'py>(
    py: Python<'py>,
    values: Vec<f32>,
    shape: &[usize],
    channels: usize,
    replicates: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let mut dims = shape.to_vec();
    if channels > 1 {
        dims.push(channels);
    }
    if replicates > 1 {
        dims.push(replicates);
    }
    Ok(PyArray1::from_vec(py, values).reshape(dims)?.into_any())
}
