//! How a scene is read.

use super::form;
use super::option::spec_group;
use crate::memory::MemoryBudget;
use crate::scene::load::LoadOptions;

spec_group! {
    /// Reading of a scene.
    pub struct LoadingSpec {
        /// Show a magenta checker in place of textures that are missing or broken.
        flag "allow-missing" allow_missing;
        /// Show the glTF file's material variant of this name (KHR_materials_variants); `mesh` lists them.
        maybe "variant" variant: form::Text, "NAME";
        /// Show the glTF file's animation at this time, in seconds. Without a
        /// time, the scene is at rest.
        maybe "time" time: form::Time, "SECONDS";
        /// Show the glTF file's animation of this name instead of its first one.
        maybe "animation" animation: form::Text, "NAME";
        /// Diameter of the balls and tubes that are shown for points and lines (glTF, PLY without faces), in units of
        /// the scene. By default it follows from the scene's size.
        maybe "stroke-width" stroke_width: form::Positive, "WIDTH";
        /// Keep all sets of texture coordinates of glTF files, up to four, for shaders of `--surface`. Without it they
        /// see those that the material's textures use; shaders that the file itself names always see all.
        flag "all-uv-sets" all_uv_sets;
    }
}

impl LoadingSpec {
    /// Options of the loaders, within a budget of memory.
    pub fn options(&self, memory: &MemoryBudget) -> LoadOptions {
        let options = LoadOptions::default().with_memory(*memory).with_allow_missing(self.allow_missing);
        let options = options.with_all_uv_sets(self.all_uv_sets);
        let options = self.variant.iter().fold(options, LoadOptions::with_variant);
        let options = self.time.iter().fold(options, |options, time| options.with_time(*time));
        let options =
            self.stroke_width.iter().fold(options, |options, width| options.with_stroke_width(*width));
        self.animation.iter().fold(options, LoadOptions::with_animation)
    }
}
