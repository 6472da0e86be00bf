//! Checks all invariants of a scene, so that no later step meets a bad index, a short array or a NaN.

mod error;
mod images;
mod instances;
mod materials;
mod mixes;

pub use error::{SceneError, ScenePart};

use super::{Environment, Light, LightShape, Object, Objects, Scene};
use glam::Vec3;

/// Greatest difference of a unit vector's squared length from 1.
const UNIT_TOLERANCE: f32 = 1e-3;

const SHARE: Range = Range { least: 0.0, most: 1.0, text: "from 0 to 1" };
const POSITIVE: Range = Range { least: 0.0, most: f32::MAX, text: "finite and at least 0" };
const COSINE: Range = Range { least: -1.0, most: 1.0, text: "from -1 to 1" };
const FINITE: Range = Range { least: f32::MIN, most: f32::MAX, text: "finite" };
const ABOVE_ZERO: Range = Range { least: f32::MIN_POSITIVE, most: f32::MAX, text: "finite and above 0" };
const INDEX_OF_REFRACTION: Range = Range { least: 1.0, most: f32::MAX, text: "finite and at least 1" };

/// Numbers that a field may have. NaN is in no range.
#[derive(Clone, Copy)]
struct Range {
    least: f32,
    most: f32,
    text: &'static str,
}

impl Range {
    /// # Errors
    /// The first value out of range.
    fn check(
        self,
        part: &ScenePart,
        field: &'static str,
        values: impl IntoIterator<Item = f32>,
    ) -> Result<(), SceneError> {
        let Self { least, most, text } = self;
        match values.into_iter().find(|value| !(least..=most).contains(value)) {
            None => Ok(()),
            Some(value) => Err(SceneError::Value { part: part.clone(), field, value, expected: text }),
        }
    }
}

impl Scene {
    /// Checks every invariant of the scene's parts, as their documentation states them: indices are in range, arrays
    /// have their lengths, numbers are finite and in range, mixes do not contain themselves, instances lie in the
    /// mesh, and the camera has a view.
    ///
    /// A scene that passes can be prepared and rendered by every integrator. The mesh is read once, by all threads of
    /// rayon's pool.
    ///
    /// ```
    /// use raystream::scene::{Material, Scene};
    ///
    /// let mut scene = Scene::default();
    /// scene.materials.push(Material::matte("wall", glam::Vec3::splat(0.5)));
    /// assert_eq!(scene.validate().expect_err("no triangles").to_string(), "the scene has no triangles");
    /// ```
    ///
    /// # Errors
    /// The first violation: the part of the scene, by index and name, its field, and what is expected.
    pub fn validate(&self) -> Result<(), SceneError> {
        self.validate_geometry()?;
        self.validate_appearance(None)
    }

    /// Checks the mesh and the instances.
    fn validate_geometry(&self) -> Result<(), SceneError> {
        self.mesh.validate(self.materials.len())?;
        self.validate_instances()
    }

    /// [`Scene::validate`] for a scene that may share its mesh and images with one that has passed. What is shared is
    /// not read again.
    ///
    /// # Errors
    /// As [`Scene::validate`].
    pub(crate) fn validate_beside(&self, valid: &Self) -> Result<(), SceneError> {
        let is_shared = self.shares_geometry(valid) && self.materials.len() >= valid.materials.len();
        if !is_shared {
            self.validate_geometry()?;
        } else if !self.shapes.is_empty() && self.masked_materials() != valid.masked_materials() {
            self.validate_instances()?;
        }
        self.validate_appearance(Some(valid))
    }

    /// Checks all but the mesh and the instances.
    fn validate_appearance(&self, valid: Option<&Self>) -> Result<(), SceneError> {
        // A new field does not compile until it is checked.
        let Self {
            mesh: _,
            shapes: _,
            objects,
            materials: _,
            textures: _,
            procedurals: _,
            scatterings: _,
            mixes: _,
            lights,
            environment,
            camera,
            camera_motion,
            cameras,
            // The command line resolves them; a prepared scene is rendered without.
            surface_requests: _,
            options: _,
            warnings: _,
            is_animated: _,
            animations: _,
            stroke_width: _,
            variants: _,
            files: _,
            moment: _,
            object_bounds: _,
        } = self;
        check_objects(objects)?;
        self.validate_textures()?;
        self.validate_materials()?;
        self.validate_mixes()?;
        lights.iter().enumerate().try_for_each(|(index, light)| check_light(index, light))?;
        match environment {
            Environment::Constant(radiance) => {
                POSITIVE.check(&ScenePart::Environment, "its radiance", radiance.to_array())?;
            }
            Environment::Map(map) => images::check_environment(map, valid)?,
        }
        for camera in camera.iter().chain(cameras.iter().map(|named| &named.camera)) {
            camera.lens(1, 1)?;
        }
        let motions = camera_motion.iter().chain(cameras.iter().filter_map(|named| named.motion.as_ref()));
        match motions.filter_map(|motion| motion.broken_node()).next() {
            Some(node) => Err(SceneError::CameraMotion { node }),
            None => Ok(()),
        }
    }
}

fn check_objects(objects: &Objects) -> Result<(), SceneError> {
    let is_inside = |object: &Object| object.parent.is_none_or(|parent| (parent as usize) < objects.len());
    match objects.iter().position(|object| !is_inside(object)) {
        None if objects.has_sound_spaces() => Ok(()),
        None => Err(SceneError::ObjectSpaces),
        Some(index) => Err(SceneError::Parent { index, count: objects.len() }),
    }
}

fn check_light(index: usize, light: &Light) -> Result<(), SceneError> {
    let part = ScenePart::Light { index, name: light.name.clone() };
    let Light { name: _, intensity, shape } = light;
    POSITIVE.check(&part, "its intensity", intensity.to_array())?;
    let position = |p: Vec3| FINITE.check(&part, "its position", p.to_array());
    let direction = |d: Vec3| {
        let unit = Range {
            least: 1.0 - UNIT_TOLERANCE,
            most: 1.0 + UNIT_TOLERANCE,
            text: "1, because directions are unit vectors",
        };
        unit.check(&part, "the squared length of its direction", [d.length_squared()])
    };
    match *shape {
        LightShape::Point { position: p } => position(p),
        LightShape::Directional { direction: d } => direction(d),
        LightShape::Spot { position: p, direction: d, cos_inner, cos_outer } => {
            position(p)?;
            direction(d)?;
            let cosine = Range { least: -1.0, most: 1.0, text: "from -1 to 1" };
            cosine.check(&part, "the cosine of its inner angle", [cos_inner])?;
            let text = "at least -1 and less than that of its inner angle";
            let outer = Range { least: -1.0, most: cos_inner.next_down(), text };
            outer.check(&part, "the cosine of its outer angle", [cos_outer])
        }
    }
}
