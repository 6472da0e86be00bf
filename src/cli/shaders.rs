//! Shaders in WGSL: `--surface`, those that scenes name, and `raystream shaders`.

use super::args::ShadersCommand;
use super::plugin_options::Setting;
use crate::program::{MAX_SOURCE_BYTES, PatternShader, prelude};
use crate::scene::{ProceduralSurface, Scene};
use anyhow::{Context, Result, bail, ensure};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The extension of shader files. A surface of a scene whose name ends so is a shader file.
const EXTENSION: &str = ".wgsl";

/// `--surface MATERIAL=FILE.wgsl[,NAME=VALUE..]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShaderSurface {
    /// The materials that get it.
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
        let values = values.split(',').filter(|value| !value.is_empty()).map(|value| {
            let (name, value) = value.split_once('=').ok_or(form)?;
            Ok((name.trim().to_owned(), value.trim().to_owned()))
        });
        Ok(Self {
            material: material.into(),
            file: file.into(),
            values: values.collect::<Result<_, String>>()?,
        })
    }
}

/// Gives materials the surfaces that the command line and the scene ask for. Returns the settings that no shader has.
pub fn apply(
    scene: &mut Scene,
    scene_file: &Path,
    surfaces: &[ShaderSurface],
    settings: &[Setting],
) -> Result<Vec<Setting>> {
    let mut used = vec![false; settings.len()];
    let requests = std::mem::take(&mut scene.surface_requests);
    let (shaders, others) = requests.into_iter().partition(|request| request.surface.ends_with(EXTENSION));
    scene.surface_requests = others;
    let shaders: Vec<crate::scene::SurfaceRequest> = shaders;
    for request in shaders {
        let material = request.material as usize;
        let name = scene.materials[material].name.clone();
        if surfaces.iter().any(|surface| surface.material == name) {
            continue;
        }
        let file = scene_file.parent().unwrap_or(Path::new("")).join(&request.surface);
        let is_regular = std::fs::metadata(&file).map_or(true, |found| found.is_file());
        ensure!(is_regular, "{}: a scene may name regular files only", file.display());
        let values = request.options.into_iter().collect::<Vec<_>>();
        let shader = load(&file, &name, &values, settings, &mut used)
            .with_context(|| format!("the shader of material {name:?}"))?;
        scene.materials[material].surface = scene.add_surface(ProceduralSurface::new(shader));
    }
    for ShaderSurface { material, file, values } in surfaces {
        let shader = load(file, material, values, settings, &mut used)?;
        scene
            .replace_surface(material, ProceduralSurface::new(shader))
            .with_context(|| format!("--surface {material}={}", file.display()))?;
    }
    let unused = settings.iter().zip(used).filter(|(_, used)| !used);
    Ok(unused.map(|(setting, _)| setting.clone()).collect())
}

/// Loads a shader with values and with the settings that are meant for it.
fn load(
    file: &Path,
    material: &str,
    values: &[(String, String)],
    settings: &[Setting],
    used: &mut [bool],
) -> Result<PatternShader> {
    let text = read(file)?;
    let shown = file.display().to_string();
    // What the parameters are called is known only now.
    let plain = PatternShader::parameters_of(&shown, &text)?;
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
    Ok(PatternShader::load(&shown, &text, all)?)
}

/// Reads a shader file.
fn read(path: &Path) -> Result<String> {
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

/// `raystream shaders`.
pub fn run(command: &ShadersCommand) -> Result<()> {
    match command {
        ShadersCommand::Prelude => stdout_line!("{}", prelude().trim_end()),
        ShadersCommand::Check { files } => {
            for file in files {
                let shown = file.display().to_string();
                let text = read(file)?;
                let shader = PatternShader::check(&shown, &text)?;
                stdout_line!("{shown}: a pattern of {} operations", shader.operations());
                for parameter in shader.parameters() {
                    let must = if parameter.has_default { "" } else { ", must be set" };
                    stdout_line!("  {}: {}{must}", parameter.name, parameter.kind);
                }
            }
        }
    }
    Ok(())
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
        for bad in ["wall", "wall=a.png", "=a.wgsl", "a.wgsl", "wall=a.wgsl,rings"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
