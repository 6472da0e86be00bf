//! **raystream** traces rays and renders pictures: on the SIMD lanes of all CPU cores, and on a GPU beside them. It
//! moves large buffers of arbitrary rays (*ray streams*) between the two, after *Ray Accelerator* (Barringer,
//! Andersson, Akenine-Möller 2017; "RA") and *Interactive Rendering with Coherent Ray Tracing* (Wald et al. 2001;
//! "RTRT").
//!
//! # Rays on a mesh
//! Vertices and indices in, hits out; no scene, service or device: [`query`].
//!
//! ```
//! use raystream::glam::Vec3;
//! use raystream::query::{Mesh, Ray};
//!
//! let mesh = Mesh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]])?;
//! let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
//! let hit = mesh.closest_one(&ray);
//! assert_eq!((hit.t, hit.primitive), (1.0, 0));
//! # Ok::<(), raystream::query::GeometryError>(())
//! ```
#![cfg_attr(
    feature = "formats",
    doc = r#"
# A picture of a scene file

```no_run
use raystream::prelude::*;

let scene = raystream::scene::load::load("scenes/showcase.json")?;
let camera = scene.camera.unwrap_or_else(|| Camera::framing(&scene.bounds(), 16.0 / 9.0));
let prepared = PreparedScene::new(scene, &Units::open(&UnitChoice::auto())?)?;
let service = Service::new(ServiceOptions::default())?;
let settings = Settings::new(640, 360).with_spp(256);
let frame = prepared.path(&camera, settings)?;
prepared.submit(&service, frame.clone(), JobOptions::default())?.wait()?;
write_image("picture.png", &frame.film().image(), &Look::default())?;
# Ok::<(), Box<dyn std::error::Error>>(())
```
"#
)]
//!
//! # Modules
//! They stand in the order in which the data flows:
//!
//! ```text
//! scene file ─load→ scene ─build→ bvh ─▶ stream ─▶ schedule ⇄ trace, shade, render ─▶ film
//! ```
//!
//! `src/ARCHITECTURE.md` is the map of the modules, `docs/glossary.md` explains the words.
//!
//! # Features
//!
//! <!-- begin: features -->
//! - `query`: Ray queries on a mesh: trees, the CPU tracer, `raystream::query`.
//! - `render`: Scenes, shading, integrators, films and the scheduler.
//! - `wgsl`: Shaders in WGSL.
//! - `meshes`: Mesh files (OBJ, PLY, STL, OFF), without their textures: no crate more than `render`.
//! - `formats`: Scene files (OBJ, glTF, PLY, recipes) and image files (PNG, EXR, HDR, NPY).
//! - `flat`: Loaded scenes as flat files, which are mapped and not decoded.
//! - `gpu`: The wgpu tracer. Without it raystream is a CPU renderer with the same scheduler.
//! - `picture`: A picture as data: `raystream::picture`.
//! - `oidn`: Open Image Denoise, loaded at run time where its library is.
//! - `nvml`: Energy, power and clocks of NVIDIA GPUs, where their driver is.
//! - `unstable`: Documents the modules that may change in any release. They can be used without it.
//! <!-- end -->
//!
//! `gpu` and `picture` are on by default. The command line, with integrators of your own, is the package
//! `raystream-cli`. A user of ray queries writes
//!
//! ```toml
//! raystream = { version = "0.1", default-features = false, features = ["query"] }
//! ```
//!
//! or `meshes` in place of `query`, if the meshes come from files.
//!
//! # Profiles
//! Cargo compiles dependencies without optimisation unless the user says otherwise. raystream then works, on threads of
//! 2 MB too, and warns once: it takes about a hundred times as long. These lines in the user's `Cargo.toml` cure it.
//! They optimise raystream and what it loads scenes with, and leave the user's own code to the debugger; all but the
//! first two halve the time of the build:
//!
//! ```toml
//! [profile.dev.package."*"]
//! opt-level = 3
//! codegen-units = 16
//! debug = false
//! debug-assertions = false
//! overflow-checks = false
//! ```
//!
//! Code that is generic over the user's types (integrators, surfaces, BSDFs) is compiled with the user's crate, in its
//! profile.
//!
//! With `panic = "abort"` panics of wgpu cannot be caught: a request for a GPU then warns.
//!
//! # Versions
//! What these pages show follows semantic versioning. Modules that they do not show (`bvh`, `device`, `trace`,
//! `meters`) may change in any release. [`glam`] and [`bytemuck`] are part of the interface: a release that raises
//! either is a breaking one. The oldest compiler is the `rust-version` of `Cargo.toml`; raising it is a minor release.

#![cfg_attr(docsrs, feature(doc_cfg))]

pub use raystream_rays::{bvh, geom, lanes, memory, profile, query, stream};
pub use {bytemuck, glam};

#[cfg(feature = "formats")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod files;
#[cfg(feature = "formats")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod numpy;
#[cfg(feature = "render")]
mod sync;

#[cfg(feature = "wgsl")]
pub mod program;
#[cfg(feature = "render")]
pub mod scene;

#[cfg(feature = "render")]
pub mod schedule;
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod trace;

#[cfg(feature = "gpu")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod device;

#[cfg(feature = "render")]
pub mod shade;

#[cfg(feature = "render")]
pub mod render;

#[cfg(feature = "render")]
pub mod engine;

#[cfg(feature = "render")]
pub mod film;

#[cfg(feature = "picture")]
pub mod picture;

#[cfg(feature = "formats")]
pub mod compare;

#[cfg(feature = "formats")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod meters;

/// The features of this build that change what it can do, by their names in Cargo.
///
/// ```
/// assert_eq!(raystream::features().any(|name| name == "gpu"), cfg!(feature = "gpu"));
/// ```
pub fn features() -> impl Iterator<Item = &'static str> {
    let all = [
        ("flat", cfg!(feature = "flat")),
        ("gpu", cfg!(feature = "gpu")),
        ("nvml", cfg!(feature = "nvml")),
        ("picture", cfg!(feature = "picture")),
    ];
    all.into_iter().filter(|(_, is_built)| *is_built).map(|(name, _)| name)
}

/// Names that most programs that render use: `use raystream::prelude::*`.
#[cfg(feature = "render")]
pub mod prelude {
    pub use crate::engine::{PreparedScene, UnitChoice, Units};
    pub use crate::film::{Exposure, Film, Image, Look, View};
    #[cfg(feature = "formats")]
    pub use crate::film::{WriteOptions, write_image, write_picture};
    pub use crate::render::{
        HitShader, HitShading, Integrator, PassOptions, PathTracer, Progressive, RayHit, RayShader, Settings,
        SurfaceHit,
    };
    pub use crate::scene::{Camera, Environment, Material, Scene};
    pub use crate::schedule::{JobHandle, JobOptions, Priority, Service, ServiceOptions};
    pub use crate::stream::{Hit, Ray};
}
