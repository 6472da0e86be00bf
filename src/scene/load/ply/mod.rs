//! Loads PLY files: ASCII, binary little-endian and binary big-endian.
//!
//! This project has its own parser, because scans contain numbers such as `1.` and `nan` normals, errors must name
//! the row, and a short header must not allocate memory for rows that the file does not contain.

mod header;
mod values;

use super::dropped::Dropped;
use super::session::Session;
use super::strokes::{self, Strokes};
use super::{LoadProblem, plain, quote};
use crate::scene::{MeshSize, Scene, TriangleMesh, srgb};
use glam::{Vec2, Vec3};
use header::{Element, Form, Header, Property};
use std::path::Path;
use values::Values;

/// Loads a PLY file: vertices (`x y z`, `nx ny nz`, `u v` or `s t`, `red green blue alpha`) and faces or triangle
/// strips. The material is matte, of the vertices' colours or grey. The vertices of a file without faces become balls.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    let path = session.path.clone();
    let bytes = session.read()?;
    let header = Header::read(&path, &bytes)?;
    let values = Values::new(&bytes, &header);
    let (mesh, dropped) = (TriangleMesh::default(), Dropped::default());
    let mut reader = Reader { path: &path, values, mesh, dropped, has_alpha: false, has_faces: false };
    for element in &header.elements {
        reader.element(element, session)?;
    }
    if !reader.has_faces {
        reader.points(session)?;
    }
    let Reader { mut mesh, dropped, has_alpha, .. } = reader;
    dropped.finish(&mut mesh.positions, &mut session.warnings);
    Ok(plain::scene(mesh, plain::one_object(&path), has_alpha, &mut session.warnings))
}

/// The meaning of a vertex property.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Position(usize),
    Normal(usize),
    Uv(usize),
    /// Red, green, blue or alpha.
    Colour(usize),
    Other,
}

impl Role {
    fn of(name: &str) -> Self {
        match name {
            "x" => Self::Position(0),
            "y" => Self::Position(1),
            "z" => Self::Position(2),
            "nx" => Self::Normal(0),
            "ny" => Self::Normal(1),
            "nz" => Self::Normal(2),
            "u" | "s" | "texture_u" | "texture_s" => Self::Uv(0),
            "v" | "t" | "texture_v" | "texture_t" => Self::Uv(1),
            "red" | "r" | "diffuse_red" => Self::Colour(0),
            "green" | "g" | "diffuse_green" => Self::Colour(1),
            "blue" | "b" | "diffuse_blue" => Self::Colour(2),
            "alpha" | "a" | "diffuse_alpha" => Self::Colour(3),
            _ => Self::Other,
        }
    }
}

/// The state of reading the rows.
struct Reader<'a> {
    path: &'a Path,
    values: Values<'a>,
    mesh: TriangleMesh,
    dropped: Dropped,
    /// True if the vertices' colours have an alpha.
    has_alpha: bool,
    has_faces: bool,
}

impl Reader<'_> {
    fn element(&mut self, element: &Element, session: &mut Session) -> Result<(), LoadProblem> {
        self.values.check_room(element).map_err(|problem| LoadProblem::Place {
            path: self.path.to_owned(),
            place: format!("element {}", element.name),
            problem,
        })?;
        match element.name.as_str() {
            "vertex" => self.vertices(element, session),
            "face" => self.faces(element, session, |corners, out| {
                out.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
            }),
            "tristrips" => self.faces(element, session, strip),
            name => {
                if name != "edge" {
                    session.warnings.add(format!("The PLY element {} is ignored.", quote(name)));
                }
                (0..element.count).try_for_each(|row| {
                    let skipped = element.properties.iter().try_for_each(|p| self.values.skip(&p.form));
                    skipped.map_err(|problem| self.error(element, row, problem))
                })
            }
        }
    }

    fn vertices(&mut self, element: &Element, session: &mut Session) -> Result<(), LoadProblem> {
        let roles: Vec<Role> = element.properties.iter().map(|p| Role::of(&p.name)).collect();
        let has = |role| roles.contains(&role);
        if let Some(axis) = (0..3).find(|&axis| !has(Role::Position(axis))) {
            let axis = ["x", "y", "z"][axis];
            return Err(self.error(element, 0, format!("the vertices have no property {axis}")));
        }
        let normals = (0..3).all(|axis| has(Role::Normal(axis)));
        let uvs = (0..2).all(|axis| has(Role::Uv(axis)));
        let colours = (0..3).all(|channel| has(Role::Colour(channel)));
        self.has_alpha = has(Role::Colour(3));
        if !colours && (0..3).any(|channel| has(Role::Colour(channel))) {
            session.warnings.add("Vertex colours need red, green and blue; parts of colours are ignored.");
        }
        let vertices = element.count as u64;
        session
            .reserve(&mut self.mesh, MeshSize { vertices, normals, uvs, colours, ..MeshSize::default() })?;
        for row in 0..element.count {
            let [mut position, mut normal, mut uv] = [[0.0_f32; 3]; 3];
            let mut colour = [1.0_f32; 4];
            for (property, role) in element.properties.iter().zip(&roles) {
                let slot = match (*role, &property.form) {
                    (Role::Position(axis), Form::Scalar(kind)) => Some((&mut position[axis], kind)),
                    (Role::Normal(axis), Form::Scalar(kind)) => Some((&mut normal[axis], kind)),
                    (Role::Uv(axis), Form::Scalar(kind)) => Some((&mut uv[axis], kind)),
                    (Role::Colour(channel), Form::Scalar(kind)) => Some((&mut colour[channel], kind)),
                    _ => None,
                };
                let full_scale = match (role, &property.form) {
                    (Role::Colour(_), Form::Scalar(kind)) => kind.full_scale(),
                    _ => 1.0,
                };
                let result = match slot {
                    Some((slot, kind)) => {
                        self.values.number(*kind).map(|value| *slot = (value / full_scale) as f32)
                    }
                    None => self.values.skip(&property.form),
                };
                result.map_err(|problem| self.error(element, row, problem))?;
            }
            let place = || match self.values.line() {
                Some(line) => format!("vertex {row} in line {line}"),
                None => format!("vertex {row}"),
            };
            self.mesh.positions.push(self.dropped.checked(position.into(), place));
            if normals {
                self.mesh.normals.push(Vec3::from(normal).normalize_or_zero());
            }
            if uvs {
                // v points up in PLY files.
                let uv = Vec2::new(uv[0], 1.0 - uv[1]);
                self.mesh.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
            }
            if colours {
                self.mesh.colours.push(srgb::decoded(colour));
            }
        }
        Ok(())
    }

    /// Reads rows with a list of vertices, which `triangulate` splits into triangles.
    fn faces(
        &mut self,
        element: &Element,
        session: &mut Session,
        triangulate: impl Fn(&[i64], &mut Vec<[i64; 3]>),
    ) -> Result<(), LoadProblem> {
        let is_list = |p: &&Property| matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
        let Some(list) = element.properties.iter().find(is_list) else {
            return Err(self.error(element, 0, "has no list vertex_indices".into()));
        };
        if element.properties.iter().any(|p| Role::of(&p.name) == Role::Colour(0)) {
            session.warnings.add("Colours of faces are ignored; those of vertices are shown.");
        }
        let vertices = self.mesh.positions.len();
        self.has_faces |= element.count > 0;
        // At least one triangle a row.
        let triangles = element.count as u64;
        session.reserve(&mut self.mesh, MeshSize { triangles, ..MeshSize::default() })?;
        let mut corners = Vec::new();
        let mut triangles = Vec::new();
        for row in 0..element.count {
            corners.clear();
            for property in &element.properties {
                let result = if std::ptr::eq(property, list) {
                    self.values.list(&property.form, &mut corners)
                } else {
                    self.values.skip(&property.form)
                };
                result.map_err(|problem| self.error(element, row, problem))?;
            }
            if corners.len() < 3 {
                session.warnings.add("Faces of fewer than 3 corners are ignored.");
                continue;
            }
            triangles.clear();
            triangulate(&corners, &mut triangles);
            for &triangle in &triangles {
                if let Some(index) = triangle.iter().find(|&&i| !(0..vertices as i64).contains(&i)) {
                    let problem = format!("names vertex {index}, but {vertices} are defined before it");
                    return Err(self.error(element, row, problem));
                }
                let triangle = triangle.map(|index| index as u32);
                if !self.dropped.drops(triangle.map(|index| self.mesh.positions[index as usize])) {
                    self.mesh.triangles.push(triangle);
                }
            }
        }
        Ok(())
    }

    /// Puts balls in the place of the vertices.
    fn points(&mut self, session: &mut Session) -> Result<(), LoadProblem> {
        let TriangleMesh { positions, uvs, colours, .. } = std::mem::take(&mut self.mesh);
        let size = MeshSize {
            uvs: !uvs.is_empty(),
            colours: !colours.is_empty(),
            ..strokes::size_of_points(positions.len() as u64)
        };
        session.reserve(&mut self.mesh, size)?;
        let for_a_while = 8 * positions.len() as u64 + 4 * size.vertices;
        session.check("points", for_a_while).map_err(|source| session.over(source))?;
        let is_kept = |index: &u32| !positions[*index as usize].is_nan();
        let points: Vec<[u32; 2]> = (0..positions.len() as u32).filter(is_kept).map(|i| [i, i]).collect();
        let mut strokes = Strokes::default();
        let stand_for = strokes.add(&mut self.mesh, &points, &positions);
        if !uvs.is_empty() {
            self.mesh.uvs.extend(stand_for.iter().map(|&vertex| uvs[vertex as usize]));
        }
        if !colours.is_empty() {
            self.mesh.colours.extend(stand_for.iter().map(|&vertex| colours[vertex as usize]));
        }
        let _ = strokes.finish(&mut self.mesh, session.options.stroke_width, &mut session.warnings);
        Ok(())
    }

    fn error(&self, element: &Element, row: usize, problem: String) -> LoadProblem {
        let path = self.path.to_owned();
        match self.values.line() {
            Some(line) => {
                LoadProblem::Line { path, line, problem: format!("{} {row}: {problem}", element.name) }
            }
            None => LoadProblem::Place { path, place: format!("{} {row}", element.name), problem },
        }
    }
}

/// Each vertex forms a triangle with the two before it. −1 begins a new strip.
fn strip(corners: &[i64], out: &mut Vec<[i64; 3]>) {
    for run in corners.split(|&corner| corner == -1) {
        for (i, w) in run.windows(3).enumerate() {
            out.push(if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] });
        }
    }
}
