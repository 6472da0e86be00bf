//! Options of the loaders.

use crate::memory::MemoryBudget;
use std::path::{Component, Path, PathBuf};

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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    pub(super) memory: MemoryBudget,
    pub(super) allow_missing: bool,
    pub(super) variant: Option<String>,
    pub(super) time: Option<f64>,
    pub(super) animation: Option<String>,
    pub(super) stroke_width: Option<f32>,
    pub(super) all_uv_sets: bool,
    pub(super) root: Option<PathBuf>,
}

impl LoadOptions {
    /// The most memory that the scene may take, with what its files take while they are read.
    #[must_use]
    pub fn with_memory(self, memory: MemoryBudget) -> Self {
        Self { memory, ..self }
    }

    /// Lets a magenta checker stand in for a texture that is missing or broken, with a warning. Otherwise such a
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

    /// The time of a glTF file's animation to show, in seconds. Before its first key and after its last one, each part
    /// keeps the pose of that key. Otherwise the pose at rest is shown.
    #[must_use]
    pub fn with_time(self, seconds: f64) -> Self {
        Self { time: Some(seconds), ..self }
    }

    /// The animation of a glTF file to show, by name, at its time ([`Self::with_time`]; 0 otherwise). One without a
    /// name is called `animation 0`, by its number. Otherwise the first one is shown.
    #[must_use]
    pub fn with_animation(self, name: impl Into<String>) -> Self {
        Self { animation: Some(name.into()), ..self }
    }

    /// Keeps all sets of texture coordinates of a glTF file's meshes, up to four, for surfaces of user code. Otherwise
    /// only materials that ask for such a surface in the file do, and others keep what their textures use.
    #[must_use]
    pub fn with_all_uv_sets(self, all_uv_sets: bool) -> Self {
        Self { all_uv_sets, ..self }
    }

    /// The diameter of the balls and tubes that stand for points and lines, above 0, in the scene's units. Otherwise it
    /// follows from the scene's size and the number of points.
    #[must_use]
    pub fn with_stroke_width(self, width: f32) -> Self {
        Self { stroke_width: Some(width), ..self }
    }

    /// The folder that a scene's files lie in: to name one outside of it is an error, whether it is there or not. The
    /// folder must hold no links. Without it a scene may name any file.
    #[must_use]
    pub fn with_root(self, root: impl Into<PathBuf>) -> Self {
        Self { root: Some(root.into()), ..self }
    }

    /// The most memory that the scene may take.
    pub fn memory(&self) -> MemoryBudget {
        self.memory
    }

    /// True if a scene may name a file.
    pub fn allows(&self, path: &Path) -> bool {
        let Some(root) = &self.root else { return true };
        let Ok(rest) = path.strip_prefix(root) else { return false };
        let mut depth = 0_u32;
        rest.components().all(|part| match part {
            Component::Normal(_) => {
                depth += 1;
                true
            }
            Component::CurDir => true,
            Component::ParentDir => match depth.checked_sub(1) {
                Some(above) => {
                    depth = above;
                    true
                }
                None => false,
            },
            Component::RootDir | Component::Prefix(_) => false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_lie_in_the_root() {
        let options = LoadOptions::default().with_root("/data/scene");
        for inside in ["/data/scene/a.png", "/data/scene/b/../a.png", "/data/scene/./b/a.png"] {
            assert!(options.allows(inside.as_ref()), "{inside}");
        }
        let outside =
            ["/etc/passwd", "/data/scene/../token", "/data/scene/b/../../token", "/data/scenes/a", "a.png"];
        for outside in outside {
            assert!(!options.allows(outside.as_ref()), "{outside}");
            assert!(LoadOptions::default().allows(outside.as_ref()));
        }
    }
}
