//! The integrators that plug into the scheduler, and what drives them: frames in flight, passes, checkpoints.
//!
//! A shader of your own is one of these; `docs/guide/add-an-integrator.md` has an example of each:
//!
//! - [`RayShader`]: a hit shader of one ray at a time. The engine keeps pixels, depths, shadow rays and loop stacks.
//! - [`recursion::Shader`]: one `async fn` that sends rays and awaits answers.
//! - [`HitShader`]: a hit shader of a batch, one ray or 8 or 16 rays at a time. The built-in integrators are such.

mod ambient_occlusion;
mod aov;
mod camera_sample;
mod checkpoint;
mod contribution;
mod dispersion;
mod dropped_splats;
mod first_hits;
mod frame;
mod frame_layers;
mod gathered;
mod hit_shader;
mod integrator;
mod media;
mod part;
#[cfg(feature = "formats")]
mod partial_film;
mod pass;
mod passable;
mod patch;
mod path_state;
mod path_tracer;
mod picture_version;
mod pixel_filter;
mod preview;
mod progressive;
mod ray_by_ray;
mod ray_rows;
mod ray_shader;
pub mod recursion;
mod recursive_whitted;
mod reflected_lamps;
mod see_through;
mod sequence;
mod settings;
mod single_ray;
mod summed;
#[cfg(test)]
mod tests;
#[cfg(feature = "wgsl")]
mod wgsl;
mod whitted;
mod whitted_node;

pub use ambient_occlusion::{AmbientOcclusion, OcclusionShader, SampleState};
pub use aov::{Aov, AovError, AovSet, UnknownAov};
pub use camera_sample::CameraSample;
pub use checkpoint::{CHECKPOINT_VERSION, CheckpointError, Identity};
pub use contribution::Contribution;
pub use dropped_splats::{Dropped, DroppedByMaterial};
pub use frame::{APERTURE_DIMENSION, CAMERA_DIMENSION, Frame};
pub use gathered::Gathered;
pub use hit_shader::{HitShader, HitShading, PathMemory};
pub use integrator::Integrator;
pub use part::Part;
#[cfg(feature = "formats")]
pub use partial_film::{PARTIAL_FILM_VERSION, PartialFilm, PartialFilmError, PartialFilmHeader};
pub use pass::{BLOCK, Blocks, Pass};
use passable::Passable;
pub use patch::{Patch, PatchError};
pub use path_state::PathState;
pub use path_tracer::{PathShader, PathTracer, ROULETTE_BOUNCES};
pub use picture_version::PICTURE_VERSION;
pub use pixel_filter::{FilterError, FilterShape, PixelFilter};
pub use preview::{PassPicture, Preview};
pub use progressive::{NoiseReport, PASSES_IN_FLIGHT, PassOptions, Progressive};
pub use ray_by_ray::RayByRay;
pub use ray_rows::{NewRays, hits_of, rays_of};
pub use ray_shader::{LIGHT_DIMENSION, PerRay, RayHit, RayShader, RayState, SurfaceHit, WaitingRay};
pub use recursive_whitted::RecursiveWhitted;
pub use sequence::Sequence;
pub use settings::{Settings, SettingsError};
pub use single_ray::render_single_rays;
#[cfg(feature = "wgsl")]
pub use wgsl::{LoopEntries, WgslIntegrator, WgslShader, WgslState};
pub use whitted::{Pending, WHITTED_BOUNCES, Whitted, WhittedShader, WhittedState};
