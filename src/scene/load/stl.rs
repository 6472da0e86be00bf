//! Loads STL files, binary and ASCII.
//!
//! This project has its own parser: errors must name the line or the triangle, triangles must keep the file's order,
//! and memory must be counted before it is taken. Each triangle has three vertices of its own, as in the file. The
//! normals of the file are not read, because many writers leave them zero; triangles are flat. The two bytes after each
//! triangle of a binary file, to which programs give different meanings, are not read either. No axis is turned.

use super::dropped::Dropped;
use super::plain::one_object;
use super::session::Session;
use super::{LoadProblem, plain, quote};
use crate::scene::{MeshSize, Object, Objects, Scene, TriangleMesh};
use glam::Vec3;
use std::path::Path;

/// Bytes before the first triangle of a binary file: 80 that mean nothing, then the number of triangles.
const HEADER: usize = 84;

/// Bytes of a triangle in a binary file: a normal, three corners, two bytes without a fixed meaning.
const RECORD: usize = 50;

/// Bytes of the shortest facet of an ASCII file.
const SHORTEST_FACET: u64 = 86;

/// True if the size of a file is that of a binary STL file with as many triangles as its header says.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    promised(bytes).is_some_and(|count| size_of(count) == bytes.len() as u64)
}

/// True if a file is an ASCII STL file. Some binary files begin with the same word, but no text holds a zero byte.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let bytes = bytes.trim_ascii_start();
    let is_solid = bytes.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    is_solid && !bytes.contains(&0)
}

/// The number of triangles that a binary header promises.
fn promised(bytes: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(HEADER - 4..HEADER)?.try_into().ok()?))
}

/// The size of a binary file in bytes.
fn size_of(triangles: u32) -> u64 {
    HEADER as u64 + RECORD as u64 * u64::from(triangles)
}

/// Loads an STL file. The material is matte grey.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    let bytes = session.read()?;
    let path = session.path.clone();
    let mut reader = Reader { mesh: TriangleMesh::default(), dropped: Dropped::default() };
    let objects = if !is_binary(&bytes) && is_text(&bytes) {
        reader.text(&path, &bytes, session)?
    } else {
        reader.binary(&bytes, session)?;
        one_object(&path)
    };
    let Reader { mut mesh, dropped } = reader;
    dropped.finish(&mut mesh.positions, &mut session.warnings);
    Ok(plain::scene(mesh, objects, false, &mut session.warnings))
}

/// The triangles so far.
struct Reader {
    mesh: TriangleMesh,
    dropped: Dropped,
}

impl Reader {
    fn add(&mut self, corners: [Vec3; 3], place: impl Fn(usize) -> String) {
        let first = self.mesh.positions.len() as u32;
        let corners: [Vec3; 3] = std::array::from_fn(|i| self.dropped.checked(corners[i], || place(i)));
        self.mesh.positions.extend(corners);
        if !self.dropped.drops(corners) {
            self.mesh.triangles.push([first, first + 1, first + 2]);
        }
    }

    fn binary(&mut self, bytes: &[u8], session: &mut Session) -> Result<(), LoadProblem> {
        let broken = |problem| LoadProblem::File { path: session.path.clone(), problem };
        let Some(count) = promised(bytes) else {
            return Err(broken(format!(
                "not an STL file: it does not begin with \"solid\", and a binary file has at least {HEADER} bytes, \
                 but it has {}",
                bytes.len()
            )));
        };
        let [size, found] = [size_of(count), bytes.len() as u64];
        if found < size {
            return Err(broken(format!(
                "truncated: its header promises {count} triangles, a file of {size} bytes, but it has {found}"
            )));
        }
        if found > size {
            session.warnings.add(format!(
                "The {} bytes after the {count} triangles that the STL header promises are ignored.",
                found - size
            ));
        }
        let triangles = u64::from(count);
        let size = MeshSize { vertices: 3 * triangles, triangles, ..MeshSize::default() };
        session.reserve(&mut self.mesh, size)?;
        for (i, record) in bytes[HEADER..].chunks_exact(RECORD).take(count as usize).enumerate() {
            let number = |k: usize| f32::from_le_bytes(std::array::from_fn(|byte| record[4 * k + byte]));
            let corner = |k: usize| Vec3::new(number(3 * k), number(3 * k + 1), number(3 * k + 2));
            // The first of the four vectors is the normal.
            self.add([corner(1), corner(2), corner(3)], |k| format!("corner {k} of triangle {i}"));
        }
        Ok(())
    }

    /// Reads the solids, each an object.
    fn text(&mut self, path: &Path, bytes: &[u8], session: &mut Session) -> Result<Objects, LoadProblem> {
        let triangles = bytes.len() as u64 / SHORTEST_FACET + 1;
        let size = MeshSize { vertices: 3 * triangles, triangles, ..MeshSize::default() };
        session.reserve(&mut self.mesh, size)?;
        let text = String::from_utf8_lossy(bytes);
        let mut words = Words::new(&text);
        let mut objects = Objects::default();
        let wrong = |line, problem| LoadProblem::Line { path: path.to_owned(), line, problem };
        while words.next().is_some() {
            let name = words.rest_of_line();
            let name = if name.is_empty() {
                path.file_stem().unwrap_or_default().to_string_lossy()
            } else {
                name.into()
            };
            let object = objects.add(Object::new(name));
            objects.assign(self.mesh.triangles.len() as u32, object);
            self.solid(&mut words).map_err(|problem| wrong(words.line, problem))?;
            words.rest_of_line();
            match words.peek() {
                Some(word) if !is(word, "solid") => {
                    return Err(wrong(words.line, format!("{} where \"solid\" should be", quote(word))));
                }
                _ => {}
            }
        }
        Ok(objects)
    }

    /// Reads the facets of a solid, up to and with `endsolid`.
    fn solid(&mut self, words: &mut Words) -> Result<(), String> {
        loop {
            match words.needed("\"facet\" or \"endsolid\"")? {
                word if is(word, "endsolid") => return Ok(()),
                word if is(word, "facet") => {}
                word => return Err(format!("{} where \"facet\" or \"endsolid\" should be", quote(word))),
            }
            let first_line = words.line;
            words.expect("normal")?;
            for _ in 0..3 {
                words.needed("a normal")?;
            }
            words.expect("outer")?;
            words.expect("loop")?;
            let mut corners = [Vec3::ZERO; 3];
            for corner in &mut corners {
                words.expect("vertex")?;
                for axis in 0..3 {
                    let word = words.needed("a coordinate")?;
                    corner[axis] = word.parse().map_err(|_| format!("{} is not a number", quote(word)))?;
                }
            }
            words.expect("endloop")?;
            words.expect("endfacet")?;
            self.add(corners, |i| format!("corner {i} of the facet in line {first_line}"));
        }
    }
}

/// True if a word is a keyword, in any case of letters.
fn is(word: &str, keyword: &str) -> bool {
    word.eq_ignore_ascii_case(keyword)
}

/// The words of a text, with their lines.
struct Words<'a> {
    rest: &'a str,
    /// The line of the last word, from 1.
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Self { rest: text, line: 1 }
    }

    fn skip_blanks(&mut self) {
        let trimmed = self.rest.trim_ascii_start();
        let blanks = &self.rest.as_bytes()[..self.rest.len() - trimmed.len()];
        self.line += blanks.iter().filter(|&&byte| byte == b'\n').count();
        self.rest = trimmed;
    }

    /// The next word, which stays the next.
    fn peek(&mut self) -> Option<&'a str> {
        self.skip_blanks();
        self.rest.split_ascii_whitespace().next()
    }

    fn next(&mut self) -> Option<&'a str> {
        let word = self.peek()?;
        self.rest = &self.rest[word.len()..];
        Some(word)
    }

    /// Rest of the line, without blanks around it.
    fn rest_of_line(&mut self) -> &'a str {
        let (line, _) = self.rest.split_once('\n').unwrap_or((self.rest, ""));
        self.rest = &self.rest[line.len()..];
        line.trim_ascii()
    }

    fn needed(&mut self, what: &str) -> Result<&'a str, String> {
        self.next().ok_or_else(|| format!("the file ends where {what} should be; it is truncated"))
    }

    fn expect(&mut self, keyword: &str) -> Result<(), String> {
        match self.needed(&format!("\"{keyword}\""))? {
            word if is(word, keyword) => Ok(()),
            word => Err(format!("{} where \"{keyword}\" should be", quote(word))),
        }
    }
}
