//! Loads PLY files: ASCII, binary little-endian and binary big-endian.
//!
//! This project has its own parser, because scans contain numbers such as `1.` and `nan` normals, errors must name
//! the row, and a short header must not allocate memory for rows that the file does not contain.

mod header;
mod values;
mod vertex;

use super::dropped::Dropped;
use super::session::Session;
use super::strokes::{self, Strokes};
use super::{LoadProblem, plain, quote};
use crate::scene::{MeshSize, Scene, TriangleMesh, VertexAttribute};
use header::{Element, Header, Property};
use std::path::Path;
use values::Values;
use vertex::{Columns, Role, Vertex};

/// Loads a PLY file: vertices (`x y z`, `nx ny nz`, `u v` or `s t`, `red green blue alpha`) and faces or triangle
/// strips. The material is matte, of the vertices' colours or grey. The vertices of a file without faces become balls.
/// Other numbers of the vertices become attributes of the mesh, by their names.
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
        if !self.mesh.positions.is_empty() {
            return Err(self.error(element, 0, "there is an element vertex before it".into()));
        }
        let columns =
            Columns::of(element, &mut session.warnings).map_err(|problem| self.error(element, 0, problem))?;
        let Columns { normals, uvs, colours, .. } = columns;
        self.has_alpha = columns.alpha;
        self.mesh.attributes = columns.attributes();
        let (vertices, numbers) = (element.count as u64, self.mesh.attributes.len() as u32);
        let size = MeshSize { vertices, normals, uvs, colours, numbers, ..MeshSize::default() };
        session.reserve(&mut self.mesh, size)?;
        let mut vertex = Vertex::default();
        for row in 0..element.count {
            vertex
                .read(&mut self.values, element, &columns)
                .map_err(|problem| self.error(element, row, problem))?;
            let place = || match self.values.line() {
                Some(line) => format!("vertex {row} in line {line}"),
                None => format!("vertex {row}"),
            };
            self.mesh.positions.push(self.dropped.checked(vertex.position.into(), place));
            if normals {
                self.mesh.normals.push(vertex.normal());
            }
            if uvs {
                self.mesh.uvs.push(vertex.uv());
            }
            if colours {
                self.mesh.colours.push(vertex.colour());
            }
            for (attribute, &number) in self.mesh.attributes.iter_mut().zip(&vertex.numbers) {
                attribute.values.push(if number.is_finite() { number } else { 0.0 });
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
        if element.properties.iter().any(|p| Role::of(&p.name) == Some(Role::Colour(0))) {
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
        let TriangleMesh { positions, uvs, colours, attributes, .. } = std::mem::take(&mut self.mesh);
        let size = MeshSize {
            uvs: !uvs.is_empty(),
            colours: !colours.is_empty(),
            numbers: attributes.len() as u32,
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
        self.mesh.attributes.extend(attributes.into_iter().map(|VertexAttribute { name, width, values }| {
            let values = stand_for.iter().map(|&vertex| values[vertex as usize]).collect();
            VertexAttribute { name, width, values }
        }));
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
