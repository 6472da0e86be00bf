//! The extension module of the wheel: arrays of Python in, queries of `raystream_rays`, arrays out.
//!
//! It has no logic of its own: what a question means stands in `raystream_rays::query`.
//!
//! | module | holds |
//! |---|---|
//! | `arrays` | arguments as contiguous numbers, answers as arrays, memory |
//! | `rays` | rays of a call |
//! | `columns`, `memory`, `answers` | the columns of an answer |
//! | `calls` | questions: arguments in, answers out |
//! | `queries`, `mesh`, `world` | classes |
//! | `target` | a mesh or a world at the time of a call |
//! | `threads` | threads of this process, forks, interrupts |

mod answers;
mod arrays;
mod calls;
mod columns;
mod memory;
mod mesh;
mod queries;
mod rays;
mod target;
mod threads;
mod world;

use pyo3::prelude::*;

/// Ray queries on meshes.
#[pymodule(gil_used = false)]
fn _raystream(module: &Bound<'_, PyModule>) -> PyResult<()> {
    threads::prepare();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("simd", raystream_rays::query::SimdLevel::detect().to_string())?;
    module.add_class::<queries::Queries>()?;
    module.add_class::<mesh::Mesh>()?;
    module.add_class::<world::World>()?;
    module.add_class::<answers::Hits>()
}
