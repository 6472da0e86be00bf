//! The class `Material`.

use crate::scene::refused;
use crate::spec::{json_of, named, python_of};
use crate::texture::Texture;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};
use raystream::scene::TextureUse;
use raystream::scene::recipe::MaterialRecipe;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What the surface of objects looks like, under a name. Objects that are given the same material share it.
///
/// Values are those of a recipe's materials: `colour` (linear, 0 to 1, white by default), `roughness`, `metallic`,
/// `clearcoat`, `coats`, `anisotropy`, `anisotropy_degrees`, `sheen`, `film`, `ior` (glass), `dispersion`,
/// `absorption`, `diffuse_transmission`, `mirror`, `emission` (radiance of the front), `alpha`, `alpha_cutoff`,
/// `normal_scale`, `surface` and `options` (a shader), `openpbr` (a dictionary of OpenPBR's parameters in place of
/// colour and roughness). Without roughness, ior, mirror and openpbr the surface is matte.
///
/// `texture` multiplies the colour, and its alpha `alpha`; `roughness_texture` (its green) the roughness,
/// `metallic_texture` (its blue) metallic, `emission_texture` the emission; `normal_texture` is a normal map as
/// glTF's. Each is a `Texture`, or pixels of one.
///
/// ValueError tells what is wrong with a value, and what is allowed.
///
/// >>> import numpy as np, raystream as rs
/// >>> rs.Material("brass", colour=[0.9, 0.7, 0.3], metallic=1, roughness=0.2)
/// Material('brass')
#[pyclass(module = "raystream", frozen)]
#[derive(Debug)]
pub struct Material {
    of: Arc<Described>,
}

/// A material as its arguments describe it.
#[derive(Debug)]
pub struct Described {
    pub name: String,
    pub recipe: MaterialRecipe,
    pub textures: BTreeMap<String, TextureUse>,
    /// All values but textures, as JSON.
    values: String,
}

impl Described {
    /// Reads the values of a material.
    ///
    /// # Errors
    /// For a value that a recipe refuses, and pixels that are none.
    pub fn new(name: &str, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let (mut values, mut textures) = (Map::new(), BTreeMap::new());
        for (key, value) in given.into_iter().flat_map(|given| given.iter()) {
            let (key, py): (String, _) = (key.extract()?, value.py());
            if value.is_none() {
                continue;
            }
            if MaterialRecipe::TEXTURES.contains(&&*key) {
                if value.is_instance_of::<PyString>() {
                    return Err(PyTypeError::new_err(format!("{key} takes a Texture or pixels, no name")));
                }
                let texture = Texture::read(&value).map_err(|error| named(py, &key, &error))?;
                textures.insert(key, texture);
                continue;
            }
            values.insert(key.clone(), json_of(&value).map_err(|error| named(py, &key, &error))?);
        }
        let told = |error: serde_json::Error| PyValueError::new_err(format!("material {name:?}: {error}"));
        let text = serde_json::to_string(&values).map_err(told)?;
        // Textures are named after the fields that they are of.
        values.extend(textures.keys().map(|key| (key.clone(), Value::String(key.clone()))));
        let recipe: MaterialRecipe = serde_json::from_value(Value::Object(values)).map_err(told)?;
        recipe.validate(name).map_err(|error| refused(&error))?;
        Ok(Self { name: name.into(), recipe, textures, values: text })
    }
}

#[pymethods]
impl Material {
    #[new]
    #[pyo3(signature = (name, /, **values))]
    fn new(name: &str, values: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Ok(Self { of: Arc::new(Described::new(name, values)?) })
    }

    /// The name.
    #[getter]
    fn name(&self) -> &str {
        &self.of.name
    }

    /// The values that were given, textures as `Texture`.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values = python_of(py, &self.of.values)?.cast_into::<PyDict>()?;
        for (key, texture) in &self.of.textures {
            values.set_item(key, Py::new(py, Texture::of(texture.clone()))?)?;
        }
        Ok(values)
    }

    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        Ok((PyTuple::new(py, [&self.of.name])?, self.values(py)?))
    }

    fn __getstate__(&self) {}

    fn __repr__(&self) -> String {
        format!("Material({:?})", self.of.name).replace('"', "'")
    }
}

impl Material {
    /// A material of arguments that have been read.
    pub fn of(described: Arc<Described>) -> Self {
        Self { of: described }
    }

    /// The material as its arguments described it.
    pub fn described(&self) -> Arc<Described> {
        self.of.clone()
    }

    /// What an argument of an object is: a material, or the values of one that has the object's name.
    ///
    /// # Errors
    /// As for the class, and for anything else.
    pub fn read(given: &Bound<'_, PyAny>, object: &str) -> PyResult<Arc<Described>> {
        if let Ok(material) = given.cast::<Self>() {
            return Ok(material.get().described());
        }
        match given.cast::<PyDict>() {
            Ok(values) => Ok(Arc::new(Described::new(object, Some(values))?)),
            Err(_) => {
                let kind = given.get_type();
                Err(PyTypeError::new_err(format!(
                    "material is a Material or a dictionary of its values, not {kind}"
                )))
            }
        }
    }
}
