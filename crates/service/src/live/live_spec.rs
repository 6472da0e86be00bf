//! The spec of a live view: what it shows, as the picture that `raystream render` makes of the same text.

use crate::contract::{Pose, ShaderTexts};
use raystream::engine::PreparedScene;
use raystream::film::Look;
use raystream::picture::{Frames, MaterialChange, RenderSpec, ShaderSurface, TimedScene, with_causes};
use raystream::program::PatternShader;
use raystream::render::Settings;
use raystream::scene::{Camera, MaterialEdit, ProceduralSurface, Scene};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A render spec that a view's requests change, with the shaders that they gave it.
///
/// Its materials and surfaces are edits of a scene that has been prepared, one change and one shader a material at the
/// most. A shader's file is a name in [`Self::texts`]; no file is read.
#[derive(Clone, Debug, Default)]
pub(super) struct LiveSpec {
    spec: RenderSpec,
    texts: ShaderTexts,
    surfaces: BTreeMap<String, ProceduralSurface>,
}

impl LiveSpec {
    /// The spec of a view, and its first camera: that of the spec, or one that frames the scene if the spec's sees
    /// nothing. The camera is written out, so that another size does not move it.
    pub fn new(mut spec: RenderSpec, scene: &Scene) -> (Self, Camera) {
        // A view shows the time itself.
        (spec.animation.shutter, spec.animation.shutter_steps) = (None, None);
        let plain = Self { spec, ..Self::default() };
        let camera = plain.camera(scene);
        let camera = camera.unwrap_or_else(|_| Camera::framing(&scene.bounds(), 16.0 / 9.0));
        (plain.posed(scene, &Pose::from(&camera)), camera)
    }

    /// The spec of a tile that a coordinator asks for. Shaders that `known` has are not compiled again.
    ///
    /// # Errors
    /// If it has other options than [`Self::tile`] gives it, or a shader has an error.
    pub fn of_tile(spec: &RenderSpec, texts: &ShaderTexts, known: &Self) -> Result<Self, String> {
        let mut plain = RenderSpec::default();
        plain.size = spec.size;
        plain.seed = spec.seed;
        plain.max_bounces = spec.max_bounces;
        plain.stop.spp = spec.stop.spp;
        plain.camera = spec.camera.clone();
        plain.optics.aperture_radius = spec.optics.aperture_radius;
        plain.optics.focus_distance = spec.optics.focus_distance;
        plain.look = spec.look.clone();
        plain.material.clone_from(&spec.material);
        plain.loading.time = spec.loading.time;
        plain.loading.animation.clone_from(&spec.loading.animation);
        let mut own = Self { spec: plain, ..Self::default() };
        for ShaderSurface { material, file, .. } in &spec.surface {
            let found = file.to_str().and_then(|file| texts.get_key_value(file));
            let (file, text) = found
                .ok_or_else(|| format!("the tile's spec names a shader that is not sent: {material}"))?;
            let known = known.surfaces.get(file).filter(|_| known.texts.get(file) == Some(text));
            own.attach(material, file, text, known.cloned())?;
        }
        if own.spec != *spec || own.texts != *texts {
            return Err("the tile's spec has options that tiles do not have".into());
        }
        Ok(own)
    }

    /// The spec of a moving frame of this size, shown by this look.
    pub fn tile(&self, settings: &Settings, look: &Look) -> RenderSpec {
        let mut tile = RenderSpec::default();
        tile.size = (settings.width, settings.height);
        tile.seed = settings.seed;
        tile.max_bounces = settings.max_bounces;
        tile.stop.spp = Some(settings.spp);
        tile.camera = self.spec.camera.clone();
        tile.optics.aperture_radius = self.spec.optics.aperture_radius;
        tile.optics.focus_distance = self.spec.optics.focus_distance;
        (tile.look.view, tile.look.exposure) = (look.view(), look.exposure());
        tile.material.clone_from(&self.spec.material);
        tile.surface.clone_from(&self.spec.surface);
        tile.loading.time = self.spec.loading.time;
        tile.loading.animation.clone_from(&self.spec.loading.animation);
        tile
    }

    /// The spec.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// The spec, to change what is neither camera nor material.
    pub fn spec_mut(&mut self) -> &mut RenderSpec {
        &mut self.spec
    }

    /// The texts of the spec's shaders.
    pub fn texts(&self) -> &ShaderTexts {
        &self.texts
    }

    /// True if the scene is shown at the same time.
    pub fn has_same_time(&self, other: &Self) -> bool {
        let (own, other) = (&self.spec.loading, &other.spec.loading);
        (own.time, &own.animation) == (other.time, &other.animation)
    }

    /// The same spec with a time in seconds, and the animation that it is of. Without a time the scene is at rest.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn timed(&self, seconds: Option<f64>, animation: Option<String>) -> Result<Self, String> {
        let mut timed = self.clone();
        match seconds {
            None => timed.spec.loading.time = None,
            Some(seconds) => {
                let text = seconds.to_string().into();
                timed.spec.set("time", &text).map_err(|error| error.to_string())?;
            }
        }
        timed.spec.loading.animation = animation.filter(|_| seconds.is_some());
        Ok(timed)
    }

    /// A prepared scene at the spec's time, without changes of its materials. One without animations is the same at all
    /// times.
    ///
    /// # Errors
    /// If the scene has no such animation, or cannot be read.
    pub fn moved(&self, rest: &PreparedScene, timed: Option<&TimedScene>) -> Result<PreparedScene, String> {
        let loading = &self.spec.loading;
        match (timed, loading.time) {
            (Some(timed), Some(seconds)) => {
                timed.at(seconds, loading.animation.as_deref()).map_err(|error| with_causes(&error))
            }
            _ => Ok(rest.clone()),
        }
    }

    /// True if the scene's materials are changed in the same way.
    pub fn has_same_materials(&self, other: &Self) -> bool {
        self.spec.material == other.spec.material
            && self.spec.surface == other.spec.surface
            && self.texts == other.texts
    }

    /// The same spec with the camera of a pose.
    pub fn posed(&self, scene: &Scene, pose: &Pose) -> Self {
        let mut posed = self.clone();
        pose.write(scene.camera.as_ref(), &mut posed.spec);
        posed
    }

    /// The same spec with an edit of the materials of a name.
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn edited(&self, material: &str, edit: MaterialEdit) -> Result<Self, String> {
        edit.check().map_err(|error| error.to_string())?;
        let mut edited = self.clone();
        match edited.spec.material.iter_mut().find(|change| change.material == material) {
            Some(change) => change.edit = edit.after(change.edit),
            None => edited.spec.material.push(MaterialChange { material: material.to_owned(), edit }),
        }
        Ok(edited)
    }

    /// The same spec with a pattern in WGSL for the materials of a name, or without theirs.
    ///
    /// # Errors
    /// What is wrong with the shader, with file, line and column.
    pub fn shaded(&self, material: &str, source: Option<&str>) -> Result<Self, String> {
        let mut shaded = self.clone();
        shaded.spec.surface.retain(|surface| surface.material != material);
        let named = |surface: &ShaderSurface| surface.file.to_str().map(str::to_owned);
        let files: Vec<String> = shaded.spec.surface.iter().filter_map(named).collect();
        shaded.texts.retain(|file, _| files.contains(file));
        shaded.surfaces.retain(|file, _| files.contains(file));
        if let Some(source) = source {
            shaded.attach(material, &file_of(material, &files), source, None)?;
        }
        Ok(shaded)
    }

    /// Gives the materials of a name a pattern of this text, which may have been compiled.
    fn attach(
        &mut self,
        material: &str,
        file: &str,
        source: &str,
        compiled: Option<ProceduralSurface>,
    ) -> Result<(), String> {
        let compile = || PatternShader::load(file, source, []).map(ProceduralSurface::from);
        let surface = compiled.map_or_else(compile, Ok).map_err(|error| error.to_string())?;
        self.surfaces.insert(file.to_owned(), surface);
        self.texts.insert(file.to_owned(), source.to_owned());
        let (material, file) = (material.to_owned(), PathBuf::from(file));
        self.spec.surface.push(ShaderSurface { material, file, values: Vec::new() });
        Ok(())
    }

    /// A prepared scene with the changes of its materials.
    ///
    /// # Errors
    /// If a material does not exist, or cannot be changed so.
    pub fn edit(&self, prepared: &PreparedScene) -> Result<PreparedScene, String> {
        let scene = self.scene(&prepared.scene)?;
        prepared.with_scene(scene).map_err(|error| error.to_string())
    }

    /// A scene with the changes of its materials, whose surfaces are told the spec's time.
    ///
    /// # Errors
    /// If a material does not exist, or cannot be changed so.
    pub fn scene(&self, scene: &Scene) -> Result<Scene, String> {
        let mut changed = scene.clone();
        for change in &self.spec.material {
            change.apply(&mut changed).map_err(|error| format!("{error:#}"))?;
        }
        for ShaderSurface { material, file, .. } in &self.spec.surface {
            let surface = file.to_str().and_then(|file| self.surfaces.get(file));
            let surface = surface.expect("a live spec has the shaders that it names");
            changed.replace_surface(material, surface.clone()).map_err(|error| error.to_string())?;
        }
        changed.moment.seconds = self.spec.loading.time.unwrap_or(0.0) as f32;
        Ok(changed)
    }

    /// The camera.
    ///
    /// # Errors
    /// If a picture of the spec's size has no view from there.
    pub fn camera(&self, scene: &Scene) -> Result<Camera, String> {
        let frames = Frames::new(&self.spec, scene).map_err(|error| format!("{error:#}"))?;
        let camera = frames.camera(&self.spec, 0).map_err(|error| format!("{error:#}"))?;
        let (width, height) = self.spec.size;
        camera.lens(width, height).map_err(|error| error.to_string())?;
        Ok(camera)
    }
}

/// A name for the shader of a material, which no other one has.
fn file_of(material: &str, others: &[String]) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let stem: String = material.chars().map(kept).take(40).collect();
    let names = (1..).map(|number| match number {
        1 => format!("{stem}.wgsl"),
        _ => format!("{stem}-{number}.wgsl"),
    });
    { names }.find(|name| !others.contains(name)).expect("there are many numbers")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use raystream::scene::Material;

    const SOURCE: &str = "fn pattern(at: Point) -> Finish { return matte(at); }";

    fn scene() -> Scene {
        let mut scene = Scene::default();
        scene.materials =
            vec![Material::matte("a wall", Vec3::splat(0.8)), Material::matte("a/wall", Vec3::ONE)];
        scene
    }

    fn red() -> MaterialEdit {
        MaterialEdit { base_colour: Some(Vec3::X), ..MaterialEdit::default() }
    }

    fn live() -> LiveSpec {
        let mut scene = scene();
        scene.camera = Some(Camera::new(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO));
        LiveSpec::new(RenderSpec::default(), &scene).0
    }

    #[test]
    fn edits_add_up_and_shaders_have_files_of_their_own() {
        let smooth = MaterialEdit { roughness: Some(0.5), ..MaterialEdit::default() };
        let edited = live().edited("a wall", red()).and_then(|spec| spec.edited("a wall", smooth));
        let edited = edited.expect("in range");
        assert_eq!(edited.spec.material[0].to_string(), "a wall,base-colour=1,0,0,roughness=0.5");
        let shaded =
            ["a wall", "a/wall"].iter().try_fold(edited, |spec, name| spec.shaded(name, Some(SOURCE)));
        let shaded = shaded.expect("shaders");
        let files: Vec<&String> = shaded.texts.keys().collect();
        assert_eq!(files, ["a_wall-2.wgsl", "a_wall.wgsl"]);
        let plain = shaded.shaded("a wall", None).expect("removed");
        let scene = plain.scene(&scene()).expect("a scene");
        assert_eq!(scene.materials[0].flat_colour(), Some(Vec3::X), "the edit is there again");
        assert_eq!((scene.materials[1].flat_colour(), plain.texts.len()), (None, 1));
        let error = live().shaded("a wall", Some("fn pattern(at: Poin) {}")).expect_err("no such type");
        assert!(error.contains("a_wall.wgsl:1:"), "{error}");
    }

    #[test]
    fn what_a_worker_is_asked_is_what_the_view_has_and_nothing_else() {
        let live = live().edited("a wall", red()).and_then(|spec| spec.shaded("a/wall", Some(SOURCE)));
        let live = live.expect("a spec");
        let settings = Settings::new(64, 36).with_spp(1);
        let tile = live.tile(&settings, &Look::default());
        let text = serde_json::to_string(&tile).expect("JSON");
        let received: RenderSpec = serde_json::from_str(&text).expect("a spec");
        let worker = LiveSpec::of_tile(&received, live.texts(), &LiveSpec::default()).expect("the view's");
        assert!(worker.has_same_materials(&live) && worker.has_same_time(&live));
        assert_eq!(worker.camera(&scene()), live.camera(&scene()));
        assert_eq!(worker.spec.settings().with_early_end(false), settings.with_max_bounces(8));
        for (key, value) in [
            ("env", "/etc/passwd"),
            ("camera-path", "/etc/passwd"),
            ("world-to-camera", "/etc/passwd"),
            ("integrator", "/etc/passwd.wgsl"),
            ("surface", "a wall=/etc/passwd.wgsl"),
            ("scene", "/etc/passwd"),
            ("frames", "0..4"),
        ] {
            let mut hostile = tile.clone();
            hostile.set(key, &value.into()).expect(key);
            assert!(LiveSpec::of_tile(&hostile, live.texts(), &live).is_err(), "{key}");
        }
        let more = live.texts().clone().into_iter().chain([("x.wgsl".to_owned(), SOURCE.to_owned())]);
        assert!(LiveSpec::of_tile(&tile, &more.collect(), &live).is_err());
    }
}
