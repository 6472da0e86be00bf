//! Shaders in WGSL: `surface`, and those that scenes name.

use super::plugin_options::Setting;
use crate::program::{MAX_SOURCE_BYTES, SurfaceShader};
use crate::scene::{Scene, Surface};
use anyhow::{Context, Result, bail, ensure};
use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::SystemTime;

/// What becomes of a shader whose file cannot be loaded anew.
const KEPT: &str = "the picture keeps the last good shader";

/// The extension of shader files. A surface of a scene whose name ends so is a shader file.
pub const EXTENSION: &str = ".wgsl";

/// `--surface MATERIAL=FILE.wgsl[,NAME=VALUE..]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShaderSurface {
    /// The name of the materials that get it; `*` stands for any text.
    pub material: String,
    /// The shader.
    pub file: PathBuf,
    /// Values of its parameters.
    pub values: Vec<(String, String)>,
}

impl FromStr for ShaderSurface {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "write MATERIAL=FILE.wgsl, or MATERIAL=FILE.wgsl,NAME=VALUE,..";
        // Names of materials may contain =, the extension ends the file's name.
        let end = text.find(&format!("{EXTENSION},")).map_or(text.len(), |at| at + EXTENSION.len());
        let (named, values) = (&text[..end], text[end..].strip_prefix(',').unwrap_or_default());
        let (material, file) = named.rsplit_once('=').ok_or(form)?;
        if material.is_empty() || !file.ends_with(EXTENSION) {
            return Err(form.into());
        }
        let mut named: Vec<(String, String)> = Vec::new();
        for value in values.split(',').filter(|value| !value.is_empty()) {
            // Numbers of a vector have commas between.
            match (value.split_once('='), named.last_mut()) {
                (Some((name, value)), _) => named.push((name.trim().to_owned(), value.trim().to_owned())),
                (None, Some((_, vector))) => *vector += &format!(",{}", value.trim()),
                (None, None) => return Err(form.into()),
            }
        }
        Ok(Self { material: material.into(), file: file.into(), values: named })
    }
}

impl fmt::Display for ShaderSurface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.material, self.file.display())?;
        self.values.iter().try_for_each(|(name, value)| write!(f, ",{name}={value}"))
    }
}

/// A shader's file, its values, and the materials that have it.
#[derive(Clone, Debug)]
struct Applied {
    file: PathBuf,
    material: String,
    /// Their numbers, and the surfaces that they have themselves.
    materials: Vec<(usize, Surface)>,
    values: Vec<(String, String)>,
    /// When the file was last changed before it was read.
    modified: Option<SystemTime>,
}

/// The shaders of a scene, to be loaded again when their files change.
#[derive(Clone, Debug, Default)]
pub struct Shaders {
    all: Vec<Applied>,
    settings: Vec<Setting>,
}

impl Shaders {
    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The scene with the shaders whose files have changed since they were read; `None` if none has changed or one has
    /// an error, which is told.
    pub fn changed(&mut self, scene: &Scene) -> Option<Scene> {
        let mut changed = None;
        for shader in &mut self.all {
            let now = modified(&shader.file);
            if now.is_none() || now == shader.modified {
                continue;
            }
            shader.modified = now;
            let Applied { file, material, materials, values, .. } = shader;
            let mut used = vec![false; self.settings.len()];
            match load(file, material, values, &self.settings, &mut used) {
                Ok(shader) => {
                    let mut new = changed.as_ref().unwrap_or(scene).clone();
                    materials.iter().for_each(|&(number, own)| new.materials[number].surface = own);
                    let numbers: Vec<usize> = materials.iter().map(|&(number, _)| number).collect();
                    match new.give_surface(&numbers, shader) {
                        Ok(()) => {
                            changed = Some(new);
                            log::info!("{}: loaded anew", file.display());
                        }
                        Err(error) => log::warn!("{error}\n{KEPT}"),
                    }
                }
                Err(error) => log::warn!("{error:#}\n{KEPT}"),
            }
        }
        changed
    }
}

fn modified(file: &Path) -> Option<SystemTime> {
    std::fs::metadata(file).and_then(|found| found.modified()).ok()
}

/// Gives materials the surfaces that the scene and then `surfaces` ask for; `between` changes the scene between them.
/// Returns the shaders, and the settings that none of them has.
pub fn apply(
    scene: &mut Scene,
    scene_file: &Path,
    surfaces: &[ShaderSurface],
    settings: &[Setting],
    between: impl FnOnce(&mut Scene) -> Result<()>,
) -> Result<(Shaders, Vec<Setting>)> {
    let mut all = Vec::new();
    let mut used = vec![false; settings.len()];
    let requests = std::mem::take(&mut scene.surface_requests);
    let (shaders, others) = requests.into_iter().partition(|request| request.surface.ends_with(EXTENSION));
    scene.surface_requests = others;
    let shaders: Vec<crate::scene::SurfaceRequest> = shaders;
    for request in shaders {
        let material = request.material as usize;
        let name = scene.materials[material].name.clone();
        if surfaces.iter().any(|surface| scene.materials_named(&surface.material).contains(&material)) {
            continue;
        }
        let file = scene_file.parent().unwrap_or(Path::new("")).join(&request.surface);
        let is_regular = std::fs::metadata(&file).map_or(true, |found| found.is_file());
        ensure!(is_regular, "{}: a scene may name regular files only", file.display());
        let values = request.options.into_iter().collect::<Vec<_>>();
        let modified = modified(&file);
        let shader = load(&file, &name, &values, settings, &mut used)
            .with_context(|| format!("the shader of material {name:?}"))?;
        let materials = vec![(material, scene.materials[material].surface)];
        scene
            .give_surface(&[material], shader)
            .with_context(|| format!("the shader of material {name:?}: {}", file.display()))?;
        all.push(Applied { file, material: name, materials, values, modified });
    }
    between(scene)?;
    for ShaderSurface { material, file, values } in surfaces {
        let modified = modified(file);
        let shader = load(file, material, values, settings, &mut used)?;
        let named = scene.materials_named(material).into_iter();
        let materials = named.map(|number| (number, scene.materials[number].surface)).collect();
        scene
            .replace_surface(material, shader)
            .with_context(|| format!("--surface {material}={}", file.display()))?;
        let (file, material, values) = (file.clone(), material.clone(), values.clone());
        all.push(Applied { file, material, materials, values, modified });
    }
    let unused = settings.iter().zip(used).filter(|(_, used)| !used);
    let unused = unused.map(|(setting, _)| setting.clone()).collect();
    Ok((Shaders { all, settings: settings.to_vec() }, unused))
}

/// Loads a shader with values and with the settings that are meant for it.
fn load(
    file: &Path,
    material: &str,
    values: &[(String, String)],
    settings: &[Setting],
    used: &mut [bool],
) -> Result<SurfaceShader> {
    let text = read(file)?;
    let shown = file.display().to_string();
    // What the parameters are called is known only now.
    let plain = SurfaceShader::parameters_of(&shown, &text)?;
    let stem = file.file_stem().map(|stem| stem.to_string_lossy()).unwrap_or_default();
    let mut all: Vec<(&str, &str)> = values.iter().map(|(name, value)| (&**name, &**value)).collect();
    for (setting, used) in settings.iter().zip(used) {
        let Setting { plugin, key, value } = setting;
        let is_meant = plugin.as_deref().is_none_or(|plugin| plugin == material || plugin == stem);
        if is_meant && plain.iter().any(|parameter| parameter.name == *key) {
            *used = true;
            all.push((key, value));
        }
    }
    Ok(SurfaceShader::load(&shown, &text, all)?)
}

/// Reads a shader file.
pub fn read(path: &Path) -> Result<String> {
    let told = || path.display().to_string();
    let file = std::fs::File::open(path).with_context(told)?;
    let mut bytes = Vec::new();
    // One byte more tells that there is more.
    file.take(MAX_SOURCE_BYTES as u64 + 1).read_to_end(&mut bytes).with_context(told)?;
    match String::from_utf8(bytes) {
        Ok(text) => Ok(text),
        Err(error) => {
            let at = error.utf8_error().valid_up_to();
            bail!("{}: no text: byte {at} is not UTF-8", path.display())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_name_material_file_and_values() {
        let parse = |text: &str| text.parse::<ShaderSurface>().map(|s| (s.material, s.file, s.values));
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(parse("wall=a/b.wgsl"), Ok(("wall".into(), "a/b.wgsl".into(), vec![])));
        assert_eq!(
            parse("a=b=c,d.wgsl,rings=3,tint=0.5"),
            Ok(("a=b".into(), "c,d.wgsl".into(), vec![pair("rings", "3"), pair("tint", "0.5")]))
        );
        assert_eq!(
            parse("a=b.wgsl,tint=1,0.5,0,rings=3"),
            Ok(("a".into(), "b.wgsl".into(), vec![pair("tint", "1,0.5,0"), pair("rings", "3")]))
        );
        for bad in ["wall", "wall=a.png", "=a.wgsl", "a.wgsl", "wall=a.wgsl,rings"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
