//! The class `Picture`.

use crate::errors::raised;
use crate::threads::Threads;
use numpy::{PyArray, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyDict, PyList};
use raystream::film::{self, LayerValues, Look, PngBits, WriteOptions};
use raystream::numpy::{Array, Values};
use raystream::picture::{RenderedFrame, Rendering};
use std::fmt;
use std::path::PathBuf;

/// A picture that has been rendered, with its layers. Notebooks show it as the spec's look does.
///
/// `image` is the radiance, linear Rec. 709. **Arrays are row major with the first row on top, and are copies:**
/// `save`, `shown` and `hash` are of what was rendered.
///
/// >>> import raystream as rs
/// >>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> picture = rs.render(mesh, size=(32, 16), spp=4, aov=["depth", "normal"])
/// >>> picture.image.shape, picture.image.dtype.name
/// ((16, 32, 3), 'float32')
/// >>> picture.layers["depth"].shape, picture.layers["normal"].shape
/// ((16, 32), (16, 32, 3))
/// >>> picture.shown().dtype.name
/// 'uint8'
#[pyclass(module = "raystream", frozen)]
pub struct Picture {
    frame: RenderedFrame,
    look: Look,
    options: WriteOptions,
    number: u32,
    name: String,
    /// The arrays by name, made at the first look.
    arrays: PyOnceLock<Py<PyDict>>,
}

impl fmt::Debug for Picture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.__repr__())
    }
}

impl Picture {
    /// The picture of a frame.
    pub fn new(frame: RenderedFrame, rendering: &Rendering, number: u32) -> Self {
        let spec = rendering.spec();
        Self {
            frame,
            look: spec.look.look(),
            options: spec.encoding.options(),
            number,
            name: rendering.frames().name(number).to_owned(),
            arrays: PyOnceLock::new(),
        }
    }

    /// All arrays by name, `image` first.
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyDict>> {
        let all = || {
            let arrays = PyDict::new(py);
            film::each_array(&self.frame.picture, |name, array| arrays.set_item(name, array_of(py, array)?))?;
            Ok::<_, PyErr>(arrays.unbind())
        };
        Ok(self.arrays.get_or_try_init(py, all)?.bind(py))
    }
}

fn array_of<'py>(py: Python<'py>, array: &Array<'_>) -> PyResult<Bound<'py, PyAny>> {
    let shape: Vec<usize> = array.shape.iter().map(|&length| length as usize).collect();
    Ok(match array.values {
        Values::F32(values) => PyArray::from_slice(py, values).reshape(shape)?.into_any(),
        Values::U32(values) => PyArray::from_slice(py, values).reshape(shape)?.into_any(),
        Values::Bool(values) => {
            let values: Vec<bool> = values.iter().map(|&bit| bit != 0).collect();
            PyArray::from_vec(py, values).reshape(shape)?.into_any()
        }
    })
}

#[pymethods]
impl Picture {
    /// The radiance, float32 `(height, width, 3)`, linear Rec. 709, premultiplied by alpha if there is one.
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.arrays(py)?.as_any().get_item("image")
    }

    /// The layers that were asked for, by name: float32 `(height, width)` or `(height, width, channels)`; ids, uint32
    /// `(height, width)`, with 4294967295 for nothing; Cryptomatte's coverage as uint32 rows (pixel, id, samples).
    /// `transparent` adds alpha.
    #[getter]
    fn layers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let layers = self.arrays(py)?.copy()?;
        layers.del_item("image")?;
        Ok(layers)
    }

    /// The names of the ids of each layer that has some.
    #[getter]
    fn names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for layer in &self.frame.picture.layers {
            match &layer.values {
                LayerValues::Ids { names, .. } if !names.is_empty() => all.set_item(layer.name, names)?,
                LayerValues::Coverage(coverage) => all.set_item(layer.name, &coverage.names)?,
                _ => {}
            }
        }
        Ok(all)
    }

    /// An array by name: "image" or a layer.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let arrays = self.arrays(py)?;
        let names = || arrays.keys().iter().map(|name| name.to_string()).collect::<Vec<_>>().join(", ");
        let missing =
            || PyKeyError::new_err(format!("there is no layer {name:?}; the picture has {}", names()));
        arrays.get_item(name)?.ok_or_else(missing)
    }

    /// The names of all arrays, "image" first.
    fn keys<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        Ok(self.arrays(py)?.keys())
    }

    /// The picture as the spec's look shows it (`view`, `exposure`, `white_balance`): uint8 `(height, width, 3)`, or 4
    /// channels with straight alpha.
    fn shown<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let picture = &self.frame.picture;
        let pixels = Threads::all()?.run(py, || film::shown_pixels(picture, &self.look));
        let channels = if picture.alpha.is_some() { 4 } else { 3 };
        let (height, width) = (picture.image.height as usize, picture.image.width as usize);
        Ok(PyArray::from_vec(py, pixels).reshape([height, width, channels])?.into_any())
    }

    /// Writes the picture in the format of the file name's extension: .png as `shown`, or .exr, .hdr, .npy, .npz with
    /// linear radiance. .exr and .npz hold the layers; beside the others they become files of their own.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let write = || film::write_picture(&path, &self.frame.picture, &self.look, &self.options);
        Threads::all()?.run(py, write).map_err(|error| raised(&error.into()))
    }

    /// The picture hash, 16 hexadecimal digits: that which `raystream render` prints for the same spec. With `denoise`
    /// it is that of the picture before its noise was removed; `metadata` has the other as `denoised_hash`.
    fn hash(&self) -> String {
        self.frame.picture.hash()
    }

    /// The hash of each layer by name.
    fn layer_hashes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let hashes = PyDict::new(py);
        for (name, hash) in self.frame.picture.layer_hashes() {
            hashes.set_item(name, hash)?;
        }
        Ok(hashes)
    }

    /// Facts that picture files hold, texts by name: camera, intrinsics, world_to_camera, spp, scene_hash, ..
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let facts = PyDict::new(py);
        for (name, text) in &self.frame.picture.metadata {
            facts.set_item(name, text)?;
        }
        Ok(facts)
    }

    /// The account: `seconds`, `mean_spp`, `passes`, `rays` (camera, continuation, shadow), `noise` (the relative
    /// standard error that is left, if the spec has a target) and `warnings` about dropped light.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (frame, stats, rays) = (&self.frame, PyDict::new(py), PyDict::new(py));
        rays.set_item("camera", frame.rays.camera)?;
        rays.set_item("continuation", frame.rays.continuation)?;
        rays.set_item("shadow", frame.rays.shadow)?;
        stats.set_item("seconds", frame.time.as_secs_f64())?;
        stats.set_item("mean_spp", frame.mean_samples)?;
        stats.set_item("passes", frame.passes)?;
        stats.set_item("rays", rays)?;
        stats.set_item("noise", frame.noise.map(|noise| noise.mean))?;
        stats.set_item("warnings", &frame.warnings)?;
        Ok(stats)
    }

    /// The number of the frame, 0 for a still picture.
    #[getter]
    fn frame(&self) -> u32 {
        self.number
    }

    /// The name of the view's camera, empty for a still picture and for frames.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let encode = || film::encode_png(&self.frame.picture, &self.look, PngBits::Eight);
        Ok(PyBytes::new(py, &Threads::all()?.run(py, encode)))
    }

    fn __repr__(&self) -> String {
        let picture = &self.frame.picture;
        let layers: Vec<&str> = picture.layers.iter().map(|layer| layer.name).collect();
        let layers = if layers.is_empty() { String::new() } else { format!(", {}", layers.join(", ")) };
        format!("Picture({}x{}{layers})", picture.image.width, picture.image.height)
    }
}
