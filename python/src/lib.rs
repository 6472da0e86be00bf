//! The extension module of the wheel: arrays of Python in, queries of `raystream_rays` and pictures of `raystream`,
//! arrays out.
//!
//! It has no logic of its own: what a question means stands in `raystream_rays::query`, what a picture is in
//! `raystream::picture`.
//!
//! | module | holds |
//! |---|---|
//! | `arrays` | arguments as contiguous numbers, answers as arrays, memory |
//! | `rays` | rays of a call |
//! | `columns`, `memory`, `answers` | the columns of an answer |
//! | `calls` | questions: arguments in, answers out |
//! | `queries`, `mesh`, `world` | classes |
//! | `target` | a mesh or a world at the time of a call |
//! | `spec`, `rendering`, `picture` | render specs, pictures |
//! | `scene`, `material`, `texture` | scenes in memory |
//! | `guarded` | values that calls of several threads read and change |
//! | `errors`, `warnings` | errors and warnings of the engine as Python's |
//! | `threads` | threads of this process, forks, interrupts |

mod answers;
mod arrays;
mod calls;
mod columns;
mod errors;
mod guarded;
mod material;
mod memory;
mod mesh;
mod picture;
mod queries;
mod rays;
mod rendering;
mod scene;
mod spec;
mod target;
mod texture;
mod threads;
mod warnings;
mod world;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use raystream_rays::query::SimdLevel;

/// What this build can do here: `version`, `simd` (the level in use), `simd_levels` (all that this processor has, best
/// first), `threads` (of a call without `threads=`) and `features` of the engine.
///
/// >>> import raystream as rs
/// >>> rs.info()["version"] == rs.__version__, rs.info()["simd"] == rs.simd
/// (True, True)
#[pyfunction]
fn info(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let info = PyDict::new(py);
    info.set_item("version", env!("CARGO_PKG_VERSION"))?;
    info.set_item("simd", SimdLevel::detect().name())?;
    let levels: Vec<&str> = SimdLevel::available().into_iter().map(SimdLevel::name).collect();
    info.set_item("simd_levels", levels)?;
    info.set_item("threads", threads::usual())?;
    info.set_item("features", raystream::features().collect::<Vec<_>>())?;
    Ok(info)
}

/// Ray queries on meshes, and pictures.
#[pymodule(gil_used = false)]
fn _raystream(module: &Bound<'_, PyModule>) -> PyResult<()> {
    threads::prepare();
    warnings::forward();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("simd", SimdLevel::detect().to_string())?;
    module.add_function(wrap_pyfunction!(calls::hemisphere, module)?)?;
    module.add_function(wrap_pyfunction!(info, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::load, module)?)?;
    module.add_function(wrap_pyfunction!(rendering::open, module)?)?;
    module.add_function(wrap_pyfunction!(rendering::render, module)?)?;
    module.add_class::<picture::Picture>()?;
    module.add_class::<rendering::Rendering>()?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<material::Material>()?;
    module.add_class::<texture::Texture>()?;
    module.add_class::<queries::Queries>()?;
    module.add_class::<mesh::Mesh>()?;
    module.add_class::<world::World>()?;
    module.add_class::<answers::Hits>()
}
