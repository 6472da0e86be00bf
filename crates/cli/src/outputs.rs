//! The files that a command writes, checked before work begins.

use anyhow::{Result, bail};
use raystream::files;
use raystream::scene::Scene;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A file and the option or argument that names it.
pub type Named<'a> = (&'static str, Option<&'a Path>);

/// The files that a command writes. No two of them are one file. Devices and pipes are left out: several outputs may
/// name one of them.
pub struct Outputs(BTreeMap<PathBuf, Output>);

struct Output {
    option: &'static str,
    path: PathBuf,
}

impl Outputs {
    /// Checks that these files can be written, that they differ, and that none of them is an input of the command.
    pub fn check<'a>(
        outputs: impl IntoIterator<Item = Named<'a>>,
        inputs: impl IntoIterator<Item = Named<'a>>,
    ) -> Result<Self> {
        let mut all = Self(BTreeMap::new());
        for (option, path) in outputs {
            let Some(path) = path else { continue };
            files::check_writable(path)?;
            let Some(identity) = files::identity(path) else { continue };
            if let Some(other) = all.0.insert(identity, Output { option, path: path.into() }) {
                bail!(
                    "{}: {} and {option} name the same file; give each its own",
                    path.display(),
                    other.option
                );
            }
        }
        for (what, path) in inputs {
            path.map_or(Ok(()), |path| all.check_input(what, path))?;
        }
        Ok(all)
    }

    /// Refuses to overwrite a file that a scene names; then makes the folders that are missing.
    pub fn check_files_of(&self, scene: &Scene) -> Result<()> {
        scene.files.iter().try_for_each(|file| self.check_input("a file that the scene names", file))?;
        self.make_folders()
    }

    /// Makes the folders of these files that are missing.
    pub fn make_folders(&self) -> Result<()> {
        self.0.values().try_for_each(|output| Ok(files::make_folder(&output.path)?))
    }

    /// Refuses to overwrite a file that is read.
    fn check_input(&self, what: &str, input: &Path) -> Result<()> {
        match files::identity(input).and_then(|identity| self.0.get(&identity)) {
            Some(Output { option, path }) => {
                bail!("{}: {option} would overwrite {what}; choose another name", path.display())
            }
            None => Ok(()),
        }
    }
}
