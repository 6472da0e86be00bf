//! POV-Ray 3.7 as a peer: a program that the user installs. It renders a scene's triangles as one `mesh2`, flat shaded.

mod scene;
mod statistics;

pub use scene::{Shadows, View, write_scene};
pub use statistics::{Times, read_times};

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A program that has said that it is POV-Ray 3.7.
#[derive(Clone, Debug)]
pub struct PovRay {
    program: PathBuf,
    /// The version that it names.
    pub version: String,
}

/// Error of POV-Ray.
#[derive(Debug, thiserror::Error)]
pub enum PovRayError {
    /// The program cannot be started.
    #[error(
        "POV-Ray cannot be started as {program}: {error}; install it (Debian's package is povray) or name the \
         program with --povray"
    )]
    Start {
        /// The program.
        program: String,
        /// The system's message.
        error: io::Error,
    },
    /// The program is another one, or of another version.
    #[error("{program} is not POV-Ray 3.7: it says {said:?}; name another program with --povray")]
    Version {
        /// The program.
        program: String,
        /// The first line of its answer.
        said: String,
    },
    /// The picture has not been rendered.
    #[error("POV-Ray has rendered nothing; it says: {0}")]
    Failed(String),
    /// A time is missing in its statistics.
    #[error("POV-Ray's statistics have no {0}")]
    Statistics(&'static str),
    /// The camera has no counterpart.
    #[error("POV-Ray gets perspective cameras without a lens shift and an aperture; this one is {0}")]
    Camera(String),
    /// A file of the scene cannot be written.
    #[error("POV-Ray's scene cannot be written: {0}")]
    Write(#[from] io::Error),
}

/// A scene in a folder of its own, which is deleted with it.
#[derive(Debug)]
pub struct WrittenScene {
    folder: tempfile::TempDir,
    view: View,
}

/// Name of the scene's file, whose folder POV-Ray runs in: paths with spaces are options to it.
const SCENE: &str = "scene.pov";
const PICTURE: &str = "picture.ppm";

impl PovRay {
    /// Asks a program for its version. A name without a folder is looked up in `PATH`.
    ///
    /// # Errors
    /// When it cannot be started or is not POV-Ray 3.7.
    pub fn find(program: &Path) -> Result<Self, PovRayError> {
        let output = run(program, None, ["--version"])?;
        let said = text(&output);
        let version = said.lines().find_map(|line| line.trim().strip_prefix("POV-Ray "));
        match version.filter(|version| version.starts_with("3.7")) {
            Some(version) => Ok(Self { program: program.to_owned(), version: version.to_owned() }),
            None => Err(PovRayError::Version {
                program: program.display().to_string(),
                said: said.lines().next().unwrap_or_default().to_owned(),
            }),
        }
    }

    /// Renders a scene with so many threads, and writes no picture. Returns its times as POV-Ray tells them.
    ///
    /// # Errors
    /// When POV-Ray fails or tells no times.
    pub fn render(&self, scene: &WrittenScene, threads: usize) -> Result<Times, PovRayError> {
        read_times(&self.said(scene, threads, &["-F"])?)
    }

    /// Renders a scene; returns its pixels, linear, row by row.
    ///
    /// # Errors
    /// When POV-Ray fails, or its picture has another size.
    pub fn picture(&self, scene: &WrittenScene) -> Result<Vec<[u8; 3]>, PovRayError> {
        self.said(scene, 1, &["+FP8", "File_Gamma=1.0", &format!("+O{PICTURE}")])?;
        let bytes = std::fs::read(scene.folder.path().join(PICTURE))?;
        let [width, height] = scene.view.size;
        let len = 3 * width as usize * height as usize;
        // A PPM file: a few lines of text, then the pixels.
        let pixels = bytes.len().checked_sub(len).filter(|_| bytes.starts_with(b"P6"));
        let pixels = pixels.ok_or_else(|| PovRayError::Failed("its picture has another size".to_owned()))?;
        Ok(bytemuck::cast_slice(&bytes[pixels..]).to_vec())
    }

    fn said(&self, scene: &WrittenScene, threads: usize, more: &[&str]) -> Result<String, PovRayError> {
        let [width, height] = scene.view.size;
        // Without antialiasing, display and questions.
        let own =
            [format!("+I{SCENE}"), format!("+W{width}"), format!("+H{height}"), format!("+WT{threads}")];
        let fixed = ["-A", "-D", "-P"];
        let options = own.iter().map(String::as_str).chain(fixed).chain(more.iter().copied());
        let output = run(&self.program, Some(scene.folder.path()), options)?;
        let said = text(&output);
        if output.status.success() && !said.contains("Render failed") {
            return Ok(said);
        }
        let last: Vec<&str> = said.lines().filter(|line| !line.trim().is_empty()).rev().take(4).collect();
        Err(PovRayError::Failed(last.into_iter().rev().collect::<Vec<_>>().join(" ")))
    }
}

/// Text that a program has written to its standard output and error.
fn text(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes)).join("\n")
}

fn run<S: AsRef<OsStr>>(
    program: &Path,
    folder: Option<&Path>,
    options: impl IntoIterator<Item = S>,
) -> Result<Output, PovRayError> {
    let mut command = Command::new(program);
    command.args(options).stdin(Stdio::null());
    if let Some(folder) = folder {
        command.current_dir(folder);
    }
    command.output().map_err(|error| PovRayError::Start { program: program.display().to_string(), error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_or_another_program_is_named_with_the_remedy() {
        let missing = PovRay::find(Path::new("no-such-renderer")).expect_err("it is not there").to_string();
        assert!(missing.contains("no-such-renderer") && missing.contains("--povray"), "{missing}");
        if let Err(other) = PovRay::find(Path::new("cargo")) {
            assert!(other.to_string().contains("cargo is not POV-Ray 3.7: it says \"cargo"), "{other}");
        }
    }
}
