//! Checks mixes.

use super::{SHARE, SceneError, ScenePart};
use crate::scene::{Material, Mix, Scene, Surface};

impl Scene {
    /// Checks the parts and shares of all mixes, and that none contains itself.
    pub(super) fn validate_mixes(&self) -> Result<(), SceneError> {
        for (index, mix) in self.mixes.iter().enumerate() {
            let part = ScenePart::Mix(index);
            let Mix { of, share } = mix;
            for index in *of {
                self.check_index(&part, "a part", "material", index, self.materials.len())?;
            }
            self.check_scalar(&part, "its share", share, SHARE)?;
        }
        self.validate_parts()?;
        self.validate_depth()
    }

    /// Lights are found by their triangles, and the alpha test knows triangles only: parts must agree with the mix.
    fn validate_parts(&self) -> Result<(), SceneError> {
        for (index, material) in self.materials.iter().enumerate() {
            let Surface::Mix(mix) = material.surface else { continue };
            for of in self.mixes[mix as usize].of {
                let other = &self.materials[of as usize];
                let Material { name: _, surface: _, emission, normal_map: _, alpha, medium } = other;
                let field = match () {
                    () if *emission != material.emission => "emission",
                    () if *alpha != material.alpha => "alpha",
                    () if *medium != material.medium => "medium",
                    () => continue,
                };
                let (part, of) = (self.material_part(index), self.material_part(of as usize));
                return Err(SceneError::MixPart { part, field, of });
            }
        }
        Ok(())
    }

    /// Removes mixes whose parts are no mixes, or are removed, until no mix is left. Takes linear time.
    fn validate_depth(&self) -> Result<(), SceneError> {
        let inner = |mix: &Mix| {
            mix.of.into_iter().filter_map(|part| match self.materials[part as usize].surface {
                Surface::Mix(inner) => Some(inner as usize),
                _ => None,
            })
        };
        let mut outer = vec![Vec::new(); self.mixes.len()];
        let mut open = vec![0; self.mixes.len()];
        for (index, mix) in self.mixes.iter().enumerate() {
            for part in inner(mix) {
                outer[part].push(index);
                open[index] += 1;
            }
        }
        let mut ready: Vec<usize> = (0..self.mixes.len()).filter(|&index| open[index] == 0).collect();
        while let Some(index) = ready.pop() {
            for &user in &outer[index] {
                open[user] -= 1;
                if open[user] == 0 {
                    ready.push(user);
                }
            }
        }
        match open.iter().position(|&parts| parts > 0) {
            Some(index) => Err(SceneError::MixCycle { part: ScenePart::Mix(index) }),
            None => Ok(()),
        }
    }
}
