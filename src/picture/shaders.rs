//! Shaders in WGSL: `surface`, and those that scenes name.

use super::picture_file::PictureFile;
use super::plugin_options::Setting;
use crate::memory::MemoryBudget;
use crate::program::{MAX_SOURCE_BYTES, Parameter, SurfaceShader, with_imports};
use crate::scene::load::LoadOptions;
use crate::scene::{BoundTexture, Scene, Surface, SurfaceRequest, TextureRef};
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

impl ShaderSurface {
    /// Replaces the paths of all files: the shader's and those of its pictures.
    ///
    /// # Errors
    /// Those of `path`.
    pub fn map_files<E>(&mut self, mut path: impl FnMut(&Path) -> Result<PathBuf, E>) -> Result<(), E> {
        self.file = path(&self.file)?;
        for (_, value) in &mut self.values {
            if let Some(mut picture) = PictureFile::of(value) {
                picture.path = path(&picture.path)?;
                *value = picture.to_string();
            }
        }
        Ok(())
    }

    /// The pictures that it names.
    pub fn pictures(&self) -> impl Iterator<Item = PictureFile> {
        self.values.iter().filter_map(|(_, value)| PictureFile::of(value))
    }
}

/// The shaders that a scene asks for.
fn shaders_of(scene: &Scene) -> impl Iterator<Item = &SurfaceRequest> {
    scene.surface_requests.iter().filter(|request| request.surface.ends_with(EXTENSION))
}

/// The pictures of the shaders that a scene asks for. Their paths lead from the scene's folder.
pub fn pictures_of(scene: &Scene) -> impl Iterator<Item = PictureFile> {
    shaders_of(scene).flat_map(|request| request.options.values()).filter_map(|value| PictureFile::of(value))
}

/// The files of the shaders that a scene asks for, and of their pictures. The paths lead from the scene's folder.
pub fn files_of(scene: &Scene) -> impl Iterator<Item = PathBuf> {
    let shaders = shaders_of(scene).map(|request| PathBuf::from(&request.surface));
    shaders.chain(pictures_of(scene).map(|picture| picture.path))
}

/// A shader's file, its values, and the materials that have it.
#[derive(Clone, Debug)]
struct Applied {
    file: PathBuf,
    material: String,
    /// Their numbers, and the surfaces that they have themselves.
    materials: Vec<(usize, Surface)>,
    values: Vec<(String, String)>,
    /// The file, those that it imports and its pictures, and when each was last changed before it was read.
    modified: Vec<(PathBuf, Option<SystemTime>)>,
}

impl Applied {
    fn new(surface: ShaderSurface, numbers: Vec<usize>, scene: &Scene) -> Self {
        let pictures = surface.pictures().map(|picture| picture.path);
        let files = std::iter::once(surface.file.clone()).chain(pictures);
        let modified = files.map(|file| (modified(&file), file)).map(|(at, file)| (file, at)).collect();
        let materials = numbers.into_iter().map(|number| (number, scene.materials[number].surface)).collect();
        let ShaderSurface { material, file, values } = surface;
        Self { file, material, materials, values, modified }
    }

    /// Watches another file, too, which has not been read yet.
    fn watch(&mut self, file: &Path) {
        if !self.modified.iter().any(|(other, _)| other == file) {
            self.modified.push((file.to_owned(), modified(file)));
        }
    }

    /// True if a file has changed since it was asked for the last time.
    fn has_changed(&mut self) -> bool {
        let mut has_changed = false;
        for (file, at) in &mut self.modified {
            let now = modified(file);
            if now.is_some() && now != *at {
                (*at, has_changed) = (now, true);
            }
        }
        has_changed
    }
}

/// The shaders of a scene, to be loaded again when their files change.
#[derive(Clone, Debug, Default)]
pub struct Shaders {
    all: Vec<Applied>,
    settings: Vec<Setting>,
    options: LoadOptions,
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
        let mut loader = Loader::new(scene, &self.settings, &self.options, Pictures::new());
        for shader in &mut self.all {
            if !shader.has_changed() {
                continue;
            }
            let mut new = changed.as_ref().unwrap_or(scene).clone();
            shader.materials.iter().for_each(|&(number, own)| new.materials[number].surface = own);
            match loader.give(&mut new, shader) {
                Ok(()) => {
                    changed = Some(new);
                    log::info!("{}: loaded anew", shader.file.display());
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
/// Returns the shaders, and the settings that none of them has. The options are those with which the scene was read.
/// Pictures among `pictures` are not read again; the others are added to them.
pub(super) fn apply(
    scene: &mut Scene,
    scene_file: &Path,
    surfaces: &[ShaderSurface],
    (settings, options): (&[Setting], &LoadOptions),
    pictures: &mut Pictures,
    between: impl FnOnce(&mut Scene) -> Result<()>,
) -> Result<(Shaders, Vec<Setting>)> {
    let mut all = Vec::new();
    let mut loader = Loader::new(scene, settings, options, std::mem::take(pictures));
    let requests = std::mem::take(&mut scene.surface_requests);
    let (shaders, others) = requests.into_iter().partition(|request| request.surface.ends_with(EXTENSION));
    scene.surface_requests = others;
    let shaders: Vec<SurfaceRequest> = shaders;
    for request in shaders {
        let number = request.material as usize;
        let material = scene.materials[number].name.clone();
        if surfaces.iter().any(|surface| scene.materials_named(&surface.material).contains(&number)) {
            continue;
        }
        let values = request.options.into_iter().collect();
        let mut surface = ShaderSurface { material, file: request.surface.into(), values };
        let beside = |file: &Path| Ok(scene_file.parent().unwrap_or(Path::new("")).join(file));
        surface.map_files::<anyhow::Error>(beside)?;
        let is_regular = std::fs::metadata(&surface.file).map_or(true, |found| found.is_file());
        ensure!(is_regular, "{}: a scene may name regular files only", surface.file.display());
        let mut shader = Applied::new(surface, vec![number], scene);
        let told = format!("the shader of material {:?}: {}", shader.material, shader.file.display());
        loader.give(scene, &mut shader).context(told)?;
        all.push(shader);
    }
    between(scene)?;
    for surface in surfaces {
        let told = || format!("--surface {}={}", surface.material, surface.file.display());
        let numbers = scene.materials_named(&surface.material);
        if numbers.is_empty() {
            return Err(scene.no_such_material(&surface.material)).with_context(told);
        }
        let mut shader = Applied::new(surface.clone(), numbers, scene);
        loader.give(scene, &mut shader).with_context(told)?;
        all.push(shader);
    }
    let unused = settings.iter().zip(&loader.used).filter(|(_, used)| !**used);
    let unused = unused.map(|(setting, _)| setting.clone()).collect();
    *pictures = loader.pictures;
    Ok((Shaders { all, settings: settings.to_vec(), options: options.clone() }, unused))
}

/// Pictures of shaders that have been read.
pub(super) type Pictures = Vec<(PictureFile, BoundTexture)>;

/// What loads shaders with their values, settings and pictures.
struct Loader<'a> {
    settings: &'a [Setting],
    /// For each setting, true if a shader has it.
    used: Vec<bool>,
    options: &'a LoadOptions,
    /// The pictures that have been read, and their bytes in all with those of the scene.
    pictures: Pictures,
    held: u64,
}

impl<'a> Loader<'a> {
    fn new(scene: &Scene, settings: &'a [Setting], options: &'a LoadOptions, pictures: Pictures) -> Self {
        let of_pictures = pictures.iter().map(|(_, picture)| size_of_val(picture.texels()) as u64);
        let (used, held) = (vec![false; settings.len()], scene.bytes() + of_pictures.sum::<u64>());
        Self { settings, used, options, pictures, held }
    }

    /// Gives materials a shader.
    fn give(&mut self, scene: &mut Scene, shader: &mut Applied) -> Result<()> {
        let text = read_with(&shader.file.clone(), |file| shader.watch(file))?;
        let shader = &*shader;
        let shown = shader.file.display().to_string();
        // What the parameters are called is known only now.
        let parameters = SurfaceShader::parameters_of(&shown, &text)?;
        let values = self.values(shader, &parameters)?;
        for (number, materials) in alike(scene, shader, &parameters) {
            let mut find = |value: &str| self.picture(scene, number, value);
            let loaded = SurfaceShader::load_with_pictures(&shown, &text, &values, &mut find)?;
            scene.give_surface(&materials, loaded)?;
        }
        Ok(())
    }

    /// The values of a shader, and the settings that are meant for it.
    fn values<'s>(&mut self, shader: &'s Applied, parameters: &[Parameter]) -> Result<Vec<(&'s str, &'s str)>>
    where
        'a: 's,
    {
        let stem = shader.file.file_stem().map(|stem| stem.to_string_lossy()).unwrap_or_default();
        let mut all: Vec<(&str, &str)> =
            shader.values.iter().map(|(name, value)| (&**name, &**value)).collect();
        for (setting, used) in self.settings.iter().zip(&mut self.used) {
            let Setting { plugin, key, value } = setting;
            let is_meant = plugin.as_deref().is_none_or(|plugin| plugin == shader.material || plugin == stem);
            let Some(parameter) = parameters.iter().find(|parameter| parameter.name == *key) else {
                continue;
            };
            if is_meant {
                ensure!(
                    !parameter.is_picture(),
                    "--set {setting}: a picture is bound beside its shader: --surface \
                     MATERIAL=FILE{EXTENSION},{key}=PICTURE, or in the scene"
                );
                *used = true;
                all.push((key, value));
            }
        }
        Ok(all)
    }

    /// The picture that a value names, on a material.
    fn picture(&mut self, scene: &Scene, material: usize, value: &str) -> Result<BoundTexture, String> {
        let Some(file) = PictureFile::of(value) else {
            let found = scene.texture_of(material, value).map_err(|error| error.to_string())?;
            return Ok(BoundTexture::of_scene(scene, found));
        };
        if let Some((_, picture)) = self.pictures.iter().find(|(other, _)| *other == file) {
            return Ok(picture.clone());
        }
        let left = self.options.memory().bytes().saturating_sub(self.held);
        let options = self.options.clone().with_memory(MemoryBudget::of_bytes(left));
        let picture = file.load(&options).map_err(|error| error.to_string())?;
        self.held += size_of_val(picture.texels()) as u64;
        self.pictures.push((file, picture.clone()));
        Ok(picture)
    }
}

/// The materials of a shader in groups for which its pictures are the same, each with a material of the group.
fn alike(scene: &Scene, shader: &Applied, parameters: &[Parameter]) -> Vec<(usize, Vec<usize>)> {
    let is_picture = |name: &str| parameters.iter().any(|other| other.is_picture() && other.name == name);
    let inputs =
        shader.values.iter().filter(|(name, value)| is_picture(name) && PictureFile::of(value).is_none());
    let inputs: Vec<&str> = inputs.map(|(_, value)| &**value).collect();
    let mut groups: Vec<(Vec<Option<TextureRef>>, Vec<usize>)> = Vec::new();
    for &(number, _) in &shader.materials {
        let own: Vec<_> = inputs.iter().map(|input| scene.texture_of(number, input).ok()).collect();
        match groups.iter_mut().find(|(other, _)| *other == own) {
            Some((_, materials)) => materials.push(number),
            None => groups.push((own, vec![number])),
        }
    }
    groups.into_iter().map(|(_, materials)| (materials[0], materials)).collect()
}

/// Reads a shader file with those that it imports: see [`with_imports`]. They lie in the folder of the first file or
/// below, whatever links say.
///
/// # Errors
/// If a file cannot be read, is none or lies elsewhere, or an import is wrong.
pub fn read(path: &Path) -> Result<String> {
    read_with(path, |_| ())
}

/// [`read`], which tells `imports` of each file before it reads it.
fn read_with(path: &Path, mut imports: impl FnMut(&Path)) -> Result<String> {
    let text = read_alone(path)?;
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let mut import = |name: &str| {
        let file = path.with_file_name(name);
        imports(&file);
        imported(folder, &file).map_err(|error| format!("{error:#}"))
    };
    Ok(with_imports(&path.display().to_string(), &text, &mut import)?)
}

/// The files that a shader file imports, without those that its text holds itself.
///
/// # Errors
/// Those of [`read`].
pub fn imports_of(path: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    read_with(path, |file| files.push(file.to_owned()))?;
    Ok(files)
}

/// The text of a file in a folder.
fn imported(folder: &Path, file: &Path) -> Result<String> {
    let told = || "it cannot be read";
    let (folder, file) = (folder.canonicalize().with_context(told)?, file.canonicalize().with_context(told)?);
    ensure!(file.starts_with(folder), "a link leads out of the shader's folder");
    ensure!(file.is_file(), "it is no regular file");
    read_alone(&file)
}

fn read_alone(path: &Path) -> Result<String> {
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

    #[test]
    fn imports_are_the_files_that_are_read_even_in_vain() {
        let folder = tempfile::tempdir().expect("a folder");
        let [shader, lib] = ["wall.wgsl", "lib.wgsl"].map(|name| folder.path().join(name));
        let text = "#import \"lib.wgsl\"\n#import \"held.wgsl\"\n#file \"held.wgsl\"\nconst HELD = 1.0;\n";
        std::fs::write(&shader, text).expect("written");
        let mut told = Vec::new();
        assert!(read_with(&shader, |file| told.push(file.to_owned())).is_err(), "a file is missing");
        assert_eq!(told, std::slice::from_ref(&lib));
        std::fs::write(&lib, "const LIB = 1.0;\n").expect("written");
        assert_eq!(imports_of(&shader).expect("all files are there"), [lib]);
    }

    #[test]
    fn imports_that_appear_or_change_while_they_are_read_are_noticed() {
        let folder = tempfile::tempdir().expect("a folder");
        let [file, lib] = ["wall.wgsl", "lib.wgsl"].map(|name| folder.path().join(name));
        std::fs::write(&file, "#import \"lib.wgsl\"\n").expect("written");
        let surface = ShaderSurface { material: "wall".into(), file, values: vec![] };
        let mut shader = Applied::new(surface, vec![], &Scene::default());
        let load = |shader: &mut Applied| read_with(&shader.file.clone(), |file| shader.watch(file));
        assert!(load(&mut shader).is_err() && !shader.has_changed());
        std::fs::write(&lib, "const LIB = 1.0;\n").expect("written");
        assert!(shader.has_changed() && load(&mut shader).is_ok() && !shader.has_changed());
    }
}
