//! The integrators that plug into the scheduler, and what drives them: frames in flight, passes, checkpoints.

mod ambient_occlusion;
mod checkpoint;
mod contribution;
mod frame;
mod integrator;
mod pass;
mod path_tracer;
mod picture_version;
mod progressive;
mod ray_by_ray;
pub mod recursion;
mod recursive_whitted;
mod sequence;
mod single_ray;
#[cfg(test)]
mod tests;
mod whitted;
mod whitted_node;

pub use ambient_occlusion::{AmbientOcclusion, SampleState};
pub use checkpoint::{CHECKPOINT_VERSION, CheckpointError, Identity};
pub use contribution::Contribution;
pub use frame::{Frame, Settings, SettingsError};
pub use integrator::Integrator;
pub use pass::{BLOCK, Blocks, Pass};
pub use path_tracer::{PathState, PathTracer, ROULETTE_BOUNCES};
pub use picture_version::PICTURE_VERSION;
pub use progressive::{NoiseReport, PASSES_IN_FLIGHT, PassOptions, Progressive};
pub use ray_by_ray::RayByRay;
pub use recursive_whitted::RecursiveWhitted;
pub use sequence::Sequence;
pub use single_ray::render_single_rays;
pub use whitted::{WHITTED_BOUNCES, Whitted, WhittedState};
