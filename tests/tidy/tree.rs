//! The files of the repository, or of a small tree made for a test.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// Folders that hold nothing of the project: build outputs, pictures, version control.
const SKIPPED: [&str; 3] = ["target", "out", ".git"];
/// Files that are read; of all others only the names are known.
const READ: [&str; 9] = ["rs", "wgsl", "md", "py", "sh", "toml", "json", "yml", "lock"];

/// Pages that tell what was tried or changed at their time: what they name may be gone.
const HISTORY: [&str; 2] = ["CHANGELOG.md", "docs/lab/"];

/// A file.
#[derive(Debug, Default)]
pub struct File {
    /// Its text; empty for what is not text.
    pub text: String,
    /// Whether it can be run.
    pub executable: bool,
}

/// Files by their path below the root, with `/` between the parts.
#[derive(Debug, Default)]
pub struct Tree {
    files: BTreeMap<String, File>,
}

/// The root of the repository: the test is one of the command line's package.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the workspace")
}

impl Tree {
    /// The repository's, read once.
    pub fn repository() -> &'static Self {
        static TREE: OnceLock<Tree> = OnceLock::new();
        TREE.get_or_init(|| {
            let mut tree = Self::default();
            tree.read(root(), "");
            assert!(tree.files.len() > 100, "the repository has more than a hundred files");
            tree
        })
    }

    /// These files.
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file = |text: &str| File { text: text.into(), executable: text.starts_with("#!/") };
        Self { files: files.iter().map(|&(path, text)| (path.into(), file(text))).collect() }
    }

    fn read(&mut self, folder: &Path, prefix: &str) {
        let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        for entry in entries.map(|entry| entry.expect("an entry of a folder")) {
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = format!("{prefix}{name}");
            if SKIPPED.contains(&name.as_str()) {
                continue;
            }
            if entry.path().is_dir() {
                self.read(&entry.path(), &format!("{path}/"));
            } else if let Some(file) = File::read(&entry.path()) {
                self.files.insert(path, file);
            }
        }
    }

    /// All files in the order of their paths.
    pub fn files(&self) -> impl Iterator<Item = (&str, &File)> {
        self.files.iter().map(|(path, file)| (path.as_str(), file))
    }

    /// Those whose names end in `.extension`.
    pub fn with_extension(&self, extension: &str) -> impl Iterator<Item = (&str, &str)> {
        let end = format!(".{extension}");
        self.files()
            .filter(move |(path, _)| path.ends_with(&end))
            .map(|(path, file)| (path, file.text.as_str()))
    }

    /// A file.
    pub fn get(&self, path: &str) -> Option<&File> {
        self.files.get(path)
    }

    /// Its text; empty where there is no such file.
    pub fn text(&self, path: &str) -> &str {
        self.get(path).map_or("", |file| file.text.as_str())
    }

    /// Whether there is a file or folder of that path.
    pub fn exists(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let folder = format!("{path}/");
        path.is_empty()
            || self.files.contains_key(path)
            || self.files.keys().any(|file| file.starts_with(&folder))
    }
}

impl File {
    /// `None` where there is nothing to read, a link without a target.
    fn read(path: &Path) -> Option<Self> {
        let mode = fs::metadata(path).ok()?;
        let extension = path.extension().map(|extension| extension.to_string_lossy());
        let text = match extension {
            Some(extension) if !READ.contains(&extension.as_ref()) => String::new(),
            _ => String::from_utf8(fs::read(path).ok()?).unwrap_or_default(),
        };
        Some(Self { text, executable: is_executable(&mode) })
    }
}

#[cfg(unix)]
fn is_executable(metadata: &fs::Metadata) -> bool {
    use std::os::unix::fs::PermissionsExt;
    metadata.permissions().mode() & 0o111 != 0
}

/// Elsewhere files have no such mark.
#[cfg(not(unix))]
fn is_executable(_: &fs::Metadata) -> bool {
    true
}

/// Whether a page tells of the past.
pub fn is_history(path: &str) -> bool {
    HISTORY.iter().any(|page| path.starts_with(page))
}

/// A path from a folder, with `.` and `..` carried out; `None` where it leads out of the root.
pub fn resolve(folder: &str, path: &str) -> Option<String> {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop()?;
            }
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

/// The folder that a file lies in.
pub fn folder_of(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

#[test]
fn paths_resolve_from_their_folder() {
    assert_eq!(resolve("src/schedule", "../ARCHITECTURE.md").as_deref(), Some("src/ARCHITECTURE.md"));
    assert_eq!(resolve("", "./a/b").as_deref(), Some("a/b"));
    assert_eq!(resolve("src", "../../secret"), None);
    assert_eq!(folder_of("README.md"), "");
}

#[test]
fn folders_exist_by_their_files() {
    let tree = Tree::of(&[("src/bvh/mod.rs", "")]);
    assert!(tree.exists("src/bvh") && tree.exists("src/bvh/") && tree.exists("src/bvh/mod.rs"));
    assert!(!tree.exists("src/bv") && !tree.exists("src/bvh/mod"));
}
