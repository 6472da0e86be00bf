//! Loads OFF files: ASCII, with normals (NOFF), colours (COFF) or texture coordinates (STOFF), in any combination.
//!
//! This project has its own parser: errors must name the line, polygons must keep the file's order, and memory must be
//! counted before it is taken.

use super::dropped::Dropped;
use super::session::Session;
use super::{LoadProblem, check_text, plain, quote};
use crate::scene::{MeshSize, Scene, TriangleMesh, srgb};
use glam::{Vec2, Vec3, Vec4};

/// Bytes of the shortest line of a vertex and of a face.
const SHORTEST_LINES: [u64; 2] = [6, 4];

/// Attributes of a file's vertices beside their position, in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Attributes {
    normals: bool,
    colours: bool,
    uvs: bool,
}

/// Splits the first word into the attributes that its prefix names and what follows `OFF`, since some files lack the
/// line break there. `None` if it is no header of OFF.
fn header(word: &str) -> Option<Result<(Attributes, &str), String>> {
    let (prefix, rest) = word.split_once("OFF")?;
    let mut left = prefix;
    let mut has = |letters: &str| match left.strip_prefix(letters) {
        Some(after) => {
            left = after;
            true
        }
        None => false,
    };
    let [uvs, colours, normals] = ["ST", "C", "N"].map(&mut has);
    let other = ["4", "n"].map(&mut has).contains(&true);
    if !left.is_empty() || !(rest.is_empty() || rest.starts_with(|c: char| c.is_ascii_digit())) {
        return None;
    }
    Some(if other {
        Err(format!("{}: vertices of three coordinates are supported", quote(word)))
    } else {
        Ok((Attributes { normals, colours, uvs }, rest))
    })
}

/// True if a text begins as an OFF file does, after comments.
pub(super) fn is_off(mut text: &[u8]) -> bool {
    while text.starts_with(b"#") {
        let end = text.iter().position(|&byte| byte == b'\n').unwrap_or(text.len());
        text = text[end..].trim_ascii_start();
    }
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len()).min(32);
    std::str::from_utf8(&text[..end]).is_ok_and(|word| header(word).is_some())
}

/// Loads an OFF file. The material is matte, of the vertices' colours or grey.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    let bytes = session.read()?;
    let path = session.path.clone();
    check_text(&path, &bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = Reader {
        lines: Lines::new(&text),
        mesh: TriangleMesh::default(),
        dropped: Dropped::default(),
        has_alpha: false,
    };
    let read = reader.read(session);
    let line = reader.lines.number;
    read.map_err(|problem| match problem {
        Problem::Here(problem) => LoadProblem::Line { path: path.clone(), line, problem },
        Problem::Load(problem) => problem,
    })?;
    let Reader { mut mesh, dropped, has_alpha, .. } = reader;
    dropped.finish(&mut mesh.positions, &mut session.warnings);
    Ok(plain::scene(mesh, plain::one_object(&path), has_alpha, &mut session.warnings))
}

/// Problem of the line that was read last, or of the whole.
enum Problem {
    Here(String),
    Load(LoadProblem),
}

impl From<String> for Problem {
    fn from(problem: String) -> Self {
        Self::Here(problem)
    }
}

/// Lines that hold words, without comments.
struct Lines<'a> {
    lines: std::str::Lines<'a>,
    /// The line that was read last, from 1.
    number: usize,
    /// Bytes of the lines that follow.
    left: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        Self { lines: text.lines(), number: 0, left: text.len() }
    }

    /// The next line. `what` should be in it.
    fn next(&mut self, what: &str) -> Result<&'a str, String> {
        loop {
            let Some(line) = self.lines.next() else {
                return Err(format!("the file ends where {what} should be; it is truncated"));
            };
            self.number += 1;
            self.left = self.left.saturating_sub(line.len() + 1);
            let line = line.split('#').next().unwrap_or("").trim_ascii();
            if !line.is_empty() {
                return Ok(line);
            }
        }
    }
}

fn number<T: std::str::FromStr>(word: &str, what: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{} is not {what}", quote(word)))
}

/// Turns colours as a file has them into linear light. They count from 0 to 255 if any number of the file is above 1,
/// else from 0 to 1. An alpha that is NaN is 1.
fn decode(colours: &mut [Vec4]) {
    // `max` leaves NaN out.
    let most = colours.iter().flat_map(|colour| colour.to_array()).fold(0.0, f32::max);
    let scale = if most > 1.0 { 255.0 } else { 1.0 };
    for colour in colours {
        let [r, g, b, alpha] = colour.to_array();
        let alpha = if alpha.is_nan() { 1.0 } else { alpha / scale };
        *colour = srgb::decoded([r / scale, g / scale, b / scale, alpha]);
    }
}

/// The state of reading a file.
struct Reader<'a> {
    lines: Lines<'a>,
    mesh: TriangleMesh,
    dropped: Dropped,
    /// True if any colour has an alpha.
    has_alpha: bool,
}

impl Reader<'_> {
    fn read(&mut self, session: &mut Session) -> Result<(), Problem> {
        let line = self.lines.next("the word OFF")?;
        let (word, rest) = line.split_at(line.find(char::is_whitespace).unwrap_or(line.len()));
        let Some(header) = header(word) else {
            return Err(Problem::Here(format!("{} where OFF should be", quote(word))));
        };
        let (attributes, glued) = header?;
        let rest = if glued.is_empty() {
            rest.trim_ascii()
        } else {
            line[line.len() - glued.len() - rest.len()..].trim_ascii()
        };
        if rest.starts_with("BINARY") {
            return Err(Problem::Here("a binary OFF file; convert it to ASCII, or to PLY".into()));
        }
        let counts = "the numbers of vertices and faces";
        let counts_line = if rest.is_empty() { self.lines.next(counts)? } else { rest };
        let mut words = counts_line.split_ascii_whitespace();
        let mut count = || match words.next() {
            Some(word) => number::<u64>(word, "a number of vertices or faces"),
            None => Err(format!("{counts} should be here")),
        };
        let (vertices, faces) = (count()?, count()?);
        self.check_room([vertices, faces])?;
        let Attributes { normals, colours, uvs } = attributes;
        let size = MeshSize { vertices, triangles: faces, normals, colours, uvs, ..MeshSize::default() };
        session.reserve(&mut self.mesh, size).map_err(Problem::Load)?;
        for vertex in 0..vertices {
            self.vertex(vertex, attributes, session)?;
        }
        decode(&mut self.mesh.colours);
        for _ in 0..faces {
            self.face(session)?;
        }
        Ok(())
    }

    /// Checks that the rest of the file can hold as many vertices and faces.
    fn check_room(&self, [vertices, faces]: [u64; 2]) -> Result<(), String> {
        let [vertex, face] = SHORTEST_LINES;
        let needed = vertices.saturating_mul(vertex).saturating_add(faces.saturating_mul(face));
        // The last line may lack its end.
        if needed <= self.lines.left as u64 + 1 {
            return Ok(());
        }
        Err(format!(
            "{vertices} vertices and {faces} faces are promised, at least {needed} bytes, but {} bytes are left; the \
             file is truncated",
            self.lines.left
        ))
    }

    fn vertex(&mut self, index: u64, has: Attributes, session: &mut Session) -> Result<(), String> {
        let mut words = self.lines.next("a vertex")?.split_ascii_whitespace();
        let mut next = |what: &str| match words.next() {
            Some(word) => number::<f32>(word, "a number"),
            None => Err(format!("the vertex has no {what}")),
        };
        let mut vector = |what: &str| Ok::<_, String>(Vec3::new(next(what)?, next(what)?, next(what)?));
        let position = vector("three coordinates")?;
        let line = self.lines.number;
        let place = || format!("vertex {index} in line {line}");
        self.mesh.positions.push(self.dropped.checked(position, place));
        if has.normals {
            self.mesh.normals.push(vector("normal")?.normalize_or_zero());
        }
        let rest: Vec<&str> = words.collect();
        let (before, uv) = rest.split_at(rest.len().saturating_sub(if has.uvs { 2 } else { 0 }));
        if has.uvs {
            let &[u, v] = uv else { return Err("the vertex has no texture coordinates".into()) };
            let uv = Vec2::new(number(u, "a number")?, 1.0 - number::<f32>(v, "a number")?);
            self.mesh.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
        }
        if has.colours {
            let mut colour = [1.0; 4];
            if !(3..=4).contains(&before.len()) {
                return Err(format!("a colour of {} numbers; it has three or four", before.len()));
            }
            for (channel, word) in colour.iter_mut().zip(before) {
                *channel = number(word, "a number")?;
            }
            if before.len() == 3 {
                colour[3] = f32::NAN;
            }
            self.has_alpha |= before.len() == 4;
            self.mesh.colours.push(colour.into());
        } else if !before.is_empty() {
            session
                .warnings
                .add("Numbers after a vertex that the first line of the OFF file does not name are ignored.");
        }
        Ok(())
    }

    fn face(&mut self, session: &mut Session) -> Result<(), String> {
        let vertices = self.mesh.positions.len();
        let mut words = self.lines.next("a face")?.split_ascii_whitespace();
        let count: u64 = number(words.next().unwrap_or_default(), "a number of corners")?;
        let mut corner = || -> Result<u32, String> {
            let word = words.next().ok_or_else(|| format!("the face has fewer than {count} corners"))?;
            let index: u64 = number(word, "the index of a vertex")?;
            match u32::try_from(index) {
                Ok(index) if (index as usize) < vertices => Ok(index),
                _ => Err(format!("names vertex {index}, but there are {vertices}")),
            }
        };
        if count < 3 {
            session.warnings.add("Faces of fewer than 3 corners are ignored.");
            return Ok(());
        }
        // Polygons become fans around their first corner.
        let (first, mut last) = (corner()?, corner()?);
        for _ in 2..count {
            let triangle = [first, last, corner()?];
            last = triangle[2];
            if !self.dropped.drops(triangle.map(|index| self.mesh.positions[index as usize])) {
                self.mesh.triangles.push(triangle);
            }
        }
        if words.next().is_some() {
            session.warnings.add("Colours of faces are ignored.");
        }
        Ok(())
    }
}
