//! Version of the pictures that this build of raystream makes.

/// Version of the pictures. Two builds with the same version give the same bytes for the same scene, camera, settings
/// and seed. Any change of a pinned picture hash raises it (`src/render/tests/pinned.rs`). Checkpoints of another
/// version are refused, since samples of two versions must not be added up.
pub const PICTURE_VERSION: u32 = 5;
