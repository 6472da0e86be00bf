//! Files that a shader imports.
//!
//! A line `#import "noise.wgsl"` takes the declarations of another file, each file once. A text may hold the files that
//! it imports: behind the first file's text, a line `#file "noise.wgsl"` begins each other one. Everything that loads
//! shaders takes such a text. Paths lead from the folder of the file that imports, those of `#file` from that of the
//! first file.

use super::source::{Fault, MAX_SOURCE_BYTES, ShaderError, error};
use naga::Span;
use std::ops::Range;
use std::path::Path;

/// The most files of a shader.
const MOST_FILES: usize = 64;

/// The ending of names of shader files.
const EXTENSION: &str = ".wgsl";

/// A line that begins with `#import` or `#file`.
struct Directive<'t> {
    is_import: bool,
    /// The path, if the line is as it should be.
    path: Option<&'t str>,
    /// The line's bytes from the sign on.
    bytes: Range<usize>,
}

/// The directives of a text, outside of comments.
fn directives(text: &str) -> Vec<Directive<'_>> {
    let (mut all, mut at, mut depth) = (Vec::new(), 0, 0);
    for line in text.split_inclusive('\n') {
        let code = line.trim_start();
        // The next file begins whatever the one before leaves open.
        match directive(code).filter(|&(is_import, _)| depth == 0 || !is_import) {
            Some((is_import, path)) => {
                let start = at + line.len() - code.len();
                depth = 0;
                all.push(Directive { is_import, path, bytes: start..start + code.trim_end().len() });
            }
            None => depth = comments_behind(line, depth),
        }
        at += line.len();
    }
    all
}

/// The kind and the path of a directive; `None` if the line is none.
fn directive(line: &str) -> Option<(bool, Option<&str>)> {
    let (is_import, rest) = match (line.strip_prefix("#import"), line.strip_prefix("#file")) {
        (Some(rest), _) => (true, rest),
        (None, rest) => (false, rest?),
    };
    if rest.starts_with(|c: char| c.is_alphanumeric() || c == '_') {
        return None;
    }
    let quoted = rest.trim().strip_prefix('"').and_then(|rest| rest.split_once('"'));
    let path = quoted.filter(|(_, rest)| rest.is_empty() || rest.trim_start().starts_with("//"));
    Some((is_import, path.map(|(path, _)| path)))
}

/// The depth of block comments behind a line.
fn comments_behind(line: &str, mut depth: usize) -> usize {
    let bytes = line.as_bytes();
    let mut at = 0;
    while let Some(two) = bytes.get(at..at + 2) {
        match two {
            b"//" if depth == 0 => break,
            b"/*" => (depth, at) = (depth + 1, at + 2),
            b"*/" if depth > 0 => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    depth
}

/// True if a path names a shader file in a folder or below.
fn is_inside(path: &str) -> bool {
    let is_plain = |part: &str| !["", ".", ".."].contains(&part) && !part.contains(['\\', ':', '\0']);
    path.ends_with(EXTENSION) && path.split('/').all(is_plain)
}

/// The path of an import from the first file's folder.
fn resolved(importer: &str, path: &str) -> String {
    match importer.rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/{path}"),
        None => path.to_owned(),
    }
}

/// A file of a shader.
#[derive(Clone, Debug)]
struct Part {
    /// The path from the folder of the first file.
    path: String,
    /// The name for messages.
    shown: String,
    /// Its bytes.
    bytes: Range<usize>,
}

/// The text of a shader, by files.
#[derive(Clone, Debug)]
pub(super) struct Files {
    text: String,
    parts: Vec<Part>,
}

impl Files {
    /// The files of a text. `file` is the name of the first file in messages.
    fn parts(file: &str, text: &str) -> Result<Self, ShaderError> {
        let named = Path::new(file);
        let path = named.file_name().map_or(file.into(), |name| name.to_string_lossy()).into_owned();
        let first = Part { path, shown: file.into(), bytes: 0..text.len() };
        let mut files = Self { text: text.to_owned(), parts: vec![first] };
        for Directive { is_import, path, bytes } in directives(text) {
            let Some(path) = path.filter(|path| is_inside(path)) else {
                return Err(files.error(&wrong(is_import), Some(bytes)));
            };
            if is_import {
                continue;
            }
            if files.parts.iter().any(|part| part.path == path) {
                let message = format!("the text has the file `{path}` twice");
                return Err(
                    files.error(&Fault::new(Span::UNDEFINED, message, "leave one of them out"), Some(bytes))
                );
            }
            if files.parts.len() == MOST_FILES {
                return Err(files.error(&too_many(), Some(bytes)));
            }
            if let Some(last) = files.parts.last_mut() {
                last.bytes.end = bytes.start;
            }
            let shown = named.with_file_name(path).display().to_string();
            let start = text[bytes.end..].find('\n').map_or(text.len(), |at| bytes.end + at + 1);
            files.parts.push(Part { path: path.to_owned(), shown, bytes: start..text.len() });
        }
        Ok(files)
    }

    /// The files of a text that has all that it imports.
    ///
    /// # Errors
    /// If a directive is wrong, a file is not there, or files import each other in a circle.
    pub fn of(file: &str, text: &str) -> Result<Self, ShaderError> {
        let files = Self::parts(file, text)?;
        for (path, bytes) in files.imports() {
            if !files.parts.iter().any(|part| part.path == path) {
                let fault = Fault::new(
                    Span::UNDEFINED,
                    format!("the file `{path}` is not in this text, which comes without a folder"),
                    format!("write its text behind a line `#file \"{path}\"`"),
                );
                return Err(files.error(&fault, Some(bytes)));
            }
        }
        let mut seen = vec![false; files.parts.len()];
        for part in 0..files.parts.len() {
            files.refuse_circles(part, &mut Vec::new(), &mut seen)?;
        }
        Ok(files)
    }

    /// Refuses circles that a file imports, and files that import each other in turn. `above` are the files that led to
    /// it, `seen` those that are known to be in no circle.
    fn refuse_circles(
        &self,
        number: usize,
        above: &mut Vec<usize>,
        seen: &mut [bool],
    ) -> Result<(), ShaderError> {
        if seen[number] {
            return Ok(());
        }
        above.push(number);
        for (path, bytes) in self.imports_of(&self.parts[number]) {
            let Some(next) = self.parts.iter().position(|part| part.path == path) else { continue };
            if let Some(start) = above.iter().position(|&other| other == next) {
                let chain = above[start..].iter().chain([&next]).map(|&other| &*self.parts[other].path);
                let message = format!("files import each other: {}", chain.collect::<Vec<_>>().join(" -> "));
                let fault =
                    Fault::new(Span::UNDEFINED, message, "put what all of them need into another file");
                return Err(self.error(&fault, Some(bytes)));
            }
            self.refuse_circles(next, above, seen)?;
        }
        above.pop();
        seen[number] = true;
        Ok(())
    }

    /// The imports: paths from the first file's folder, and their lines.
    fn imports(&self) -> impl Iterator<Item = (String, Range<usize>)> {
        self.parts.iter().flat_map(|part| self.imports_of(part))
    }

    /// The imports of one file.
    fn imports_of(&self, part: &Part) -> impl Iterator<Item = (String, Range<usize>)> {
        let found = directives(&self.text[part.bytes.clone()]).into_iter();
        found.filter(|directive| directive.is_import).map(|Directive { path, bytes, .. }| {
            let (start, path) = (part.bytes.start, path.unwrap_or_default());
            (resolved(&part.path, path), start + bytes.start..start + bytes.end)
        })
    }

    /// The whole text with blanks in place of directives: each byte stays where it is.
    pub fn code(&self) -> String {
        let mut code = self.text.clone();
        for Directive { bytes, .. } in directives(&self.text) {
            code.replace_range(bytes.clone(), &" ".repeat(bytes.len()));
        }
        code
    }

    /// The name of the first file.
    pub fn first(&self) -> &str {
        &self.parts[0].shown
    }

    /// The error for a fault at some bytes of the whole text, or of the whole first file.
    pub fn error(&self, fault: &Fault, range: Option<Range<usize>>) -> ShaderError {
        let first = &self.parts[0];
        let Some(range) = range else { return error(&first.shown, "", None, fault) };
        let is_of = |part: &&Part| part.bytes.start <= range.start;
        let part = self.parts.iter().rev().find(is_of).unwrap_or(first);
        let own = range.start - part.bytes.start..range.end.max(range.start) - part.bytes.start;
        error(&part.shown, &self.text[part.bytes.clone()], Some(own), fault)
    }
}

/// The fault of too many files.
fn too_many() -> Fault {
    let message = format!("the shader has more than {MOST_FILES} files");
    Fault::new(Span::UNDEFINED, message, "put some of them into one")
}

/// The fault of a directive that is not as it should be.
fn wrong(is_import: bool) -> Fault {
    match is_import {
        true => Fault::new(
            Span::UNDEFINED,
            "this imports no shader file",
            "write `#import \"noise.wgsl\"`, the path of a file in the folder of this one or below",
        ),
        false => Fault::new(
            Span::UNDEFINED,
            "this begins no shader file",
            "write `#file \"noise.wgsl\"`, a path in the folder of the shader or below",
        ),
    }
}

/// The text of a file with those of all files that it imports. `read` is given a path from the folder of `file`, or
/// says in a part of a sentence why it cannot be read.
///
/// ```
/// use raystream::program::{SurfaceShader, with_imports};
///
/// let text = "#import \"shades.wgsl\"
///     fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = vec3f(grey()); return f; }";
/// let mut read = |path: &str| match path {
///     "shades.wgsl" => Ok("fn grey() -> f32 { return 0.5; }".to_owned()),
///     _ => Err("there is no such file".to_owned()),
/// };
/// let whole = with_imports("wall.wgsl", text, &mut read)?;
/// SurfaceShader::load("wall.wgsl", &whole, [])?;
/// # Ok::<(), raystream::program::ShaderError>(())
/// ```
///
/// # Errors
/// If an import is wrong, a file cannot be read, or there are too many files or bytes.
pub fn with_imports(
    file: &str,
    text: &str,
    read: &mut dyn FnMut(&str) -> Result<String, String>,
) -> Result<String, ShaderError> {
    let mut files = Files::parts(file, text)?;
    // Files are looked at in their order, those that are read last of all.
    let mut number = 0;
    while number < files.parts.len() {
        let imports: Vec<(String, Range<usize>)> = files.imports_of(&files.parts[number]).collect();
        for (path, bytes) in imports {
            if files.parts.iter().any(|other| other.path == path) {
                continue;
            }
            let refused = |files: &Files, message: String, remedy: &str| {
                Err(files.error(&Fault::new(Span::UNDEFINED, message, remedy), Some(bytes.clone())))
            };
            if files.parts.len() == MOST_FILES {
                return Err(files.error(&too_many(), Some(bytes)));
            }
            let more = match read(&path) {
                Ok(more) => more,
                Err(reason) => {
                    let message = format!("`{path}` cannot be imported: {reason}");
                    return refused(&files, message, "name a file in the folder of the shader or below");
                }
            };
            let mut whole = std::mem::take(&mut files.text);
            if !whole.ends_with('\n') {
                whole.push('\n');
            }
            whole += &format!("#file \"{path}\"\n{more}");
            if whole.len() > MAX_SOURCE_BYTES {
                files.text = whole;
                let message = format!("with `{path}` the shader has more than {MAX_SOURCE_BYTES} bytes");
                return refused(&files, message, "import less");
            }
            files = Files::parts(file, &whole)?;
        }
        number += 1;
    }
    Ok(files.text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::SurfaceShader;

    const WALL: &str = "// A wall.\n#import \"lib/brick.wgsl\" // and what it needs\n  #import \"shades.wgsl\"\n\
        fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = brick(at.uv) * grey(); return f; }";

    fn file(path: &str) -> Result<String, String> {
        let text = match path {
            "shades.wgsl" => {
                "/* #import \"none.wgsl\" */\n/*\n#import \"none.wgsl\"\n*/ fn grey() -> f32 { return LIGHT; }"
            }
            "lib/brick.wgsl" => {
                "#import \"mortar.wgsl\"\nfn brick(p: vec2f) -> vec3f { return vec3f(p, mortar()); }"
            }
            "lib/mortar.wgsl" => "const LIGHT = 0.5;\nfn mortar() -> f32 { return LIGHT; }",
            "lib/wrong.wgsl" => "\nfn wrong() -> f32 {\n    return nose(1.0);\n}",
            "round.wgsl" => "#import \"about.wgsl\"",
            "about.wgsl" => "\n#import \"round.wgsl\"",
            "open.wgsl" => "const OPEN = 1.0; /* without an end",
            "lib/bad.wgsl" => "\n#import <bad>",
            "many.wgsl" => return Ok((0..99).map(|i| format!("#import \"m{i}.wgsl\"\n")).collect()),
            _ if path.starts_with('m') => "",
            _ => return Err("there is none".into()),
        };
        Ok(text.into())
    }

    /// The text with its imports, checked as a shader; else the error.
    fn check(text: &str) -> Result<String, String> {
        let whole = with_imports("walls/wall.wgsl", text, &mut file).map_err(|error| error.to_string())?;
        SurfaceShader::check("walls/wall.wgsl", &whole).map_err(|error| error.to_string())?;
        Ok(whole)
    }

    /// A pattern of some text.
    fn with(head: &str) -> String {
        format!("{head}\nfn pattern(at: Point) -> Finish {{ return matte(at); }}")
    }

    #[test]
    fn files_are_read_once_and_a_text_with_all_of_them_is_the_same_shader() {
        let whole = check(WALL).unwrap_or_else(|error| panic!("{error}"));
        let held: Vec<&str> = whole.lines().filter_map(|line| line.strip_prefix("#file ")).collect();
        assert_eq!(held, [r#""lib/brick.wgsl""#, r#""shades.wgsl""#, r#""lib/mortar.wgsl""#]);
        assert_eq!(
            with_imports("walls/wall.wgsl", &whole, &mut |_| Err("read".into())).as_deref(),
            Ok(&*whole)
        );
        let debug = |text: &str| format!("{:?}", SurfaceShader::check("wall.wgsl", text).expect("valid"));
        assert_eq!(debug(&whole), debug(&whole.replace("lib/", "sub/").replace("shades.", "sheets.")));
        let hash = |text: &str| {
            let shader = crate::program::PatternShader::load("wall.wgsl", text, []).expect("valid");
            format!("{shader:?}")
        };
        assert_ne!(
            hash(&whole),
            hash(&whole.replace("LIGHT = 0.5", "LIGHT = 0.6")),
            "an import is part of it"
        );
        check(&with("#import \"shades.wgsl\"\r\n#import \"lib/mortar.wgsl\"\r\n"))
            .expect("lines of any kind");
    }

    #[test]
    fn errors_name_the_file_the_line_and_the_column() {
        for (head, says) in [
            (
                "#import \"lib/wrong.wgsl\"",
                " --> walls/lib/wrong.wgsl:3:12\n  |\n3 |     return nose(1.0);\n",
            ),
            (
                "\n  #import \"none.wgsl\"",
                "`none.wgsl` cannot be imported: there is none\n --> walls/wall.wgsl:2:3",
            ),
            ("#import \"round.wgsl\"", "round.wgsl -> about.wgsl -> round.wgsl\n --> walls/about.wgsl:2:1"),
            ("#import \"wall.wgsl\"", "wall.wgsl -> wall.wgsl\n --> walls/wall.wgsl:1:1"),
            ("#import \"lib/bad.wgsl\"", "this imports no shader file\n --> walls/lib/bad.wgsl:2:1"),
            ("#import \"open.wgsl\"", " --> walls/open.wgsl:1:"),
            ("#import \"many.wgsl\"", "more than 64 files\n --> walls/many.wgsl:63:1"),
            ("#import \"lib/mortar.wgsl\"\nconst LIGHT = 1.0;", "LIGHT"),
            ("#file \"a.wgsl\"\n#file \"a.wgsl\"", "the file `a.wgsl` twice\n --> walls/a.wgsl:1:1"),
            ("#file a", "this begins no shader file"),
        ] {
            let error = check(&with(head)).expect_err(head);
            assert!(error.contains(says), "{head}:\n{error}");
        }
        for path in
            ["../a.wgsl", "/a.wgsl", "a.txt", "", "a//b.wgsl", "./a.wgsl", "C:a.wgsl", "a\\b.wgsl", ".wgsl/"]
        {
            let error = check(&with(&format!("#import \"{path}\""))).expect_err(path);
            assert!(error.contains("imports no shader file"), "{path}: {error}");
        }
        for head in ["#import", "#import a.wgsl", "#import \"a.wgsl", "#import \"a.wgsl\" as b"] {
            let error = check(&with(head)).expect_err(head);
            assert!(error.contains("imports no shader file"), "{head}: {error}");
        }
        let error = SurfaceShader::check("wall.wgsl", &with("#import \"a.wgsl\""))
            .expect_err("no folder")
            .to_string();
        assert!(error.contains("`a.wgsl` is not in this text") && error.contains("wall.wgsl:1:1"), "{error}");
        let large = format!("//{}", "x".repeat(MAX_SOURCE_BYTES));
        let error = with_imports("wall.wgsl", &with("#import \"a.wgsl\""), &mut |_| Ok(large.clone()));
        assert!(error.expect_err("too long").to_string().contains("more than 1048576 bytes"));
    }

    #[test]
    fn errors_of_several_files_are_told_at_once() {
        let error = check("#import \"lib/wrong.wgsl\"\nfn pattern(at: Point) -> Finish { return mate(at); }");
        let error = error.expect_err("two errors");
        for place in ["walls/lib/wrong.wgsl:3:12", "walls/wall.wgsl:2:42"] {
            assert!(error.contains(place), "{place}:\n{error}");
        }
    }
}
