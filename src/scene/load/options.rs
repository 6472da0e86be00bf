//! What a caller may ask of the loaders.

use crate::memory::MemoryBudget;

/// Options of loading a scene. By default a scene may take most of the machine's memory, and a texture that is missing
/// is an error.
///
/// ```
/// use raystream::memory::MemoryBudget;
/// use raystream::scene::load::{LoadOptions, load_with};
///
/// let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(4 << 30)).with_allow_missing(true);
/// let scene = load_with("scenes/cornell.json", &options)?;
/// # assert!(scene.warnings.is_empty());
/// # Ok::<(), raystream::scene::load::LoadError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    pub(super) memory: MemoryBudget,
    pub(super) allow_missing: bool,
    pub(super) variant: Option<String>,
}

impl LoadOptions {
    /// The most memory that the scene may take, with what its files take while they are read.
    #[must_use]
    pub fn with_memory(self, memory: MemoryBudget) -> Self {
        Self { memory, ..self }
    }

    /// Whether a magenta checker stands in for a texture that is missing or broken, with a warning. Otherwise such a
    /// texture is an error.
    #[must_use]
    pub fn with_allow_missing(self, allow_missing: bool) -> Self {
        Self { allow_missing, ..self }
    }

    /// The material variant of a glTF file to show (KHR_materials_variants; [`crate::scene::Scene::variants`] lists
    /// them). Otherwise each mesh has its own material.
    #[must_use]
    pub fn with_variant(self, variant: impl Into<String>) -> Self {
        Self { variant: Some(variant.into()), ..self }
    }
}
