//! The class `Texture`.

use crate::arrays::{Named, Numbers, check_memory, numbers, of_any_kind};
use glam::Vec2;
use numpy::{PyArray, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use raystream::scene::{TextureImage, TextureRef, TextureUse, Wrap};

/// An image for materials, and how it lies on a mesh.
///
/// `pixels` are `(height, width)`, or `(height, width, channels)` with 1, 3 or 4 of them, the first row on top:
/// **uint8 as image files have it, sRGB where the material takes a colour and linear where it takes numbers or normals;
/// floating numbers are linear, from 0 to 1**. The fourth channel is alpha, which is linear. Textures have 8 bits a
/// channel. Of another `Texture` the image is shared.
///
/// `wrap` is "repeat", "mirror" or "clamp", for both axes or one each. `uv` is the number of the mesh's texture
/// coordinates; they are multiplied by `scale`, turned by `rotation_degrees` and moved by `offset`, as glTF's are.
///
/// ValueError names the first number that is out of range.
///
/// >>> import numpy as np, raystream as rs
/// >>> rs.Texture(np.zeros((4, 8, 3), np.uint8), wrap="clamp", scale=(2, 2))
/// Texture(8x4)
#[pyclass(module = "raystream", frozen)]
#[derive(Debug)]
pub struct Texture {
    of: TextureUse,
}

const WRAPS: [(&str, Wrap); 3] = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];

#[pymethods]
impl Texture {
    #[new]
    #[pyo3(signature = (
        pixels, *, wrap=None, uv=0, offset=(0.0, 0.0), rotation_degrees=0.0, scale=(1.0, 1.0)
    ))]
    fn new(
        pixels: &Bound<'_, PyAny>,
        wrap: Option<&Bound<'_, PyAny>>,
        uv: u32,
        offset: (f32, f32),
        rotation_degrees: f32,
        scale: (f32, f32),
    ) -> PyResult<Self> {
        let (offset, scale) = (Vec2::from(offset), Vec2::from(scale));
        if !(offset.is_finite() && scale.is_finite() && rotation_degrees.is_finite()) {
            return Err(PyValueError::new_err("offset, rotation_degrees and scale must be finite"));
        }
        let (image, wrap) = (image_of(pixels)?, wraps(wrap)?);
        let rotation = rotation_degrees.to_radians();
        let place = TextureRef { set: uv, offset, rotation, scale, ..TextureRef::plain(0) };
        Ok(Self { of: TextureUse { wrap, place, ..TextureUse::plain(image) } })
    }

    /// Width and height.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.of.image.size()
    }

    /// A copy of the pixels, `(height, width, 4)`: uint8 or float32.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (width, height) = self.of.image.size();
        let shape = [height as usize, width as usize, 4];
        match (self.of.image.as_bytes(), self.of.image.as_linear()) {
            (Some(bytes), _) => Ok(PyArray::from_slice(py, bytes.as_flattened()).reshape(shape)?.into_any()),
            (_, linear) => {
                let numbers = linear.unwrap_or_default().as_flattened();
                Ok(PyArray::from_slice(py, numbers).reshape(shape)?.into_any())
            }
        }
    }

    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let TextureRef { set, offset, rotation, scale, .. } = self.of.place;
        let name = |wrap: Wrap| WRAPS.iter().find(|(_, known)| *known == wrap).map(|(name, _)| *name);
        let keywords = PyDict::new(py);
        keywords.set_item("wrap", self.of.wrap.map(name))?;
        keywords.set_item("uv", set)?;
        keywords.set_item("offset", (offset.x, offset.y))?;
        keywords.set_item("rotation_degrees", rotation.to_degrees())?;
        keywords.set_item("scale", (scale.x, scale.y))?;
        Ok((PyTuple::new(py, [self.pixels(py)?])?, keywords))
    }

    fn __getstate__(&self) {}

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        format!("Texture({width}x{height})")
    }
}

impl Texture {
    /// A texture of the engine's.
    pub fn of(texture: TextureUse) -> Self {
        Self { of: texture }
    }

    /// What an argument of a material is: a texture, or pixels of one.
    ///
    /// # Errors
    /// As for the class.
    pub fn read(given: &Bound<'_, PyAny>) -> PyResult<TextureUse> {
        match given.cast::<Self>() {
            Ok(texture) => Ok(texture.get().of.clone()),
            Err(_) => Ok(TextureUse::plain(image_of(given)?)),
        }
    }
}

fn wraps(given: Option<&Bound<'_, PyAny>>) -> PyResult<[Wrap; 2]> {
    let Some(given) = given else { return Ok([Wrap::Repeat; 2]) };
    let names: [String; 2] = match given.extract::<String>() {
        Ok(name) => [name.clone(), name],
        Err(_) => given.extract()?,
    };
    let [u, v] = names.map(|name| {
        let known = WRAPS.iter().find(|(known, _)| *known == name).map(|(_, wrap)| *wrap);
        known.ok_or_else(|| {
            PyValueError::new_err(format!("wrap is {name:?}; it must be \"repeat\", \"mirror\" or \"clamp\""))
        })
    });
    Ok([u?, v?])
}

/// The image of a texture or an array.
fn image_of(given: &Bound<'_, PyAny>) -> PyResult<TextureImage> {
    if let Ok(texture) = given.cast::<Texture>() {
        return Ok(texture.get().of.image.clone());
    }
    let (array, kind) = of_any_kind(given)?;
    let name = array.getattr(intern!(given.py(), "dtype"))?.to_string();
    let image = if name == "uint8" {
        let (size, pixels) = rgba(&numbers::<u8>(&array, "pixels")?, u8::MAX)?;
        TextureImage::of_bytes(size, pixels)
    } else if kind == 'f' {
        let (size, pixels) = rgba(&numbers::<f32>(&array, "pixels")?, 1.0)?;
        TextureImage::of_linear(size, pixels)
    } else {
        return Err(PyTypeError::new_err(format!(
            "pixels are {name}; they must be uint8, or floating numbers from 0 to 1"
        )));
    };
    image.map_err(|error| PyValueError::new_err(format!("pixels: {error}")))
}

/// Width and height, and pixels with four channels.
type Pixels<T> = ((u32, u32), Vec<[T; 4]>);

/// Width, height and the pixels with four channels.
fn rgba<T: Named + Copy>(given: &Numbers<'_, T>, opaque: T) -> PyResult<Pixels<T>> {
    let (height, width, channels) = match *given.shape() {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] => (height, width, channels),
        ref shape => {
            return Err(PyValueError::new_err(format!(
                "pixels have the shape {shape:?}; it must be (height, width) or (height, width, 1, 3 or 4)"
            )));
        }
    };
    let side = |length: usize| u32::try_from(length).ok().filter(|&length| length > 0);
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(PyValueError::new_err(format!("pixels: an image of {width}x{height}")));
    };
    let numbers = given.as_slice()?;
    check_memory("a texture", numbers.len() / channels, size_of::<[T; 4]>())?;
    let pixels = match channels {
        1 => numbers.iter().map(|&grey| [grey, grey, grey, opaque]).collect(),
        3 => numbers.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, opaque]).collect(),
        _ => numbers.as_chunks().0.to_vec(),
    };
    Ok(((width, height), pixels))
}
