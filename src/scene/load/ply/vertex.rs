//! Reads the vertices of a PLY file.

use super::super::quote;
use super::super::warnings::Warnings;
use super::header::{Element, Form};
use super::values::Values;
use crate::scene::{VertexAttribute, srgb};
use glam::{Vec2, Vec3, Vec4};

/// Numbers of a vertex that are kept as attributes. Files of splats have 60, which fill the memory.
const MOST_ATTRIBUTES: usize = 16;

/// The meaning of a vertex property.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Role {
    Position(usize),
    Normal(usize),
    Uv(usize),
    /// Red, green, blue or alpha.
    Colour(usize),
    /// The number of an attribute.
    Attribute(usize),
    Other,
}

impl Role {
    /// The meaning that a name has by convention.
    pub fn of(name: &str) -> Option<Self> {
        Some(match name {
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
            _ => return None,
        })
    }
}

/// The properties of the vertices.
pub(super) struct Columns<'a> {
    roles: Vec<Role>,
    /// Names of the attributes.
    names: Vec<&'a str>,
    pub normals: bool,
    pub uvs: bool,
    pub colours: bool,
    /// True if colours have an alpha.
    pub alpha: bool,
}

impl<'a> Columns<'a> {
    /// The properties of an element.
    ///
    /// # Errors
    /// When a coordinate is missing.
    pub fn of(element: &'a Element, warnings: &mut Warnings) -> Result<Self, String> {
        let (mut names, mut left_out) = (Vec::new(), None);
        let mut role = |name: &'a str, form: &Form| {
            if let Some(role) = Role::of(name) {
                return role;
            }
            if !matches!(form, Form::Scalar(_)) || names.contains(&name) {
                return Role::Other;
            }
            if names.len() == MOST_ATTRIBUTES {
                left_out.get_or_insert(name);
                return Role::Other;
            }
            names.push(name);
            Role::Attribute(names.len() - 1)
        };
        let roles: Vec<Role> = element.properties.iter().map(|p| role(&p.name, &p.form)).collect();
        if let Some(name) = left_out {
            warnings.add(format!(
                "Vertices keep {MOST_ATTRIBUTES} numbers as attributes; {} and those after it are ignored.",
                quote(name)
            ));
        }
        let has = |role| roles.contains(&role);
        if let Some(axis) = (0..3).find(|&axis| !has(Role::Position(axis))) {
            return Err(format!("the vertices have no property {}", ["x", "y", "z"][axis]));
        }
        let colours = (0..3).all(|channel| has(Role::Colour(channel)));
        if !colours && (0..3).any(|channel| has(Role::Colour(channel))) {
            warnings.add("Vertex colours need red, green and blue; parts of colours are ignored.");
        }
        let normals = (0..3).all(|axis| has(Role::Normal(axis)));
        let uvs = (0..2).all(|axis| has(Role::Uv(axis)));
        let alpha = has(Role::Colour(3));
        Ok(Self { roles, names, normals, uvs, colours, alpha })
    }

    /// The attributes, without vertices.
    pub fn attributes(&self) -> Vec<VertexAttribute> {
        let attribute = |name: &&str| VertexAttribute { name: (*name).into(), width: 1, values: Vec::new() };
        self.names.iter().map(attribute).collect()
    }
}

/// A row.
#[derive(Default)]
pub(super) struct Vertex {
    pub position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    colour: [f32; 4],
    /// The attributes.
    pub numbers: Vec<f32>,
}

impl Vertex {
    /// Reads the next row.
    ///
    /// # Errors
    /// Those of [`Values::number`].
    pub fn read(&mut self, values: &mut Values, element: &Element, columns: &Columns) -> Result<(), String> {
        self.colour = [1.0; 4];
        self.numbers.resize(columns.names.len(), 0.0);
        for (property, role) in element.properties.iter().zip(&columns.roles) {
            let (slot, kind) = match (*role, &property.form) {
                (Role::Position(axis), Form::Scalar(kind)) => (&mut self.position[axis], kind),
                (Role::Normal(axis), Form::Scalar(kind)) => (&mut self.normal[axis], kind),
                (Role::Uv(axis), Form::Scalar(kind)) => (&mut self.uv[axis], kind),
                (Role::Attribute(number), Form::Scalar(kind)) => (&mut self.numbers[number], kind),
                (Role::Colour(channel), Form::Scalar(kind)) => {
                    self.colour[channel] = (values.number(*kind)? / kind.full_scale()) as f32;
                    continue;
                }
                _ => {
                    values.skip(&property.form)?;
                    continue;
                }
            };
            *slot = values.number(*kind)? as f32;
        }
        Ok(())
    }

    /// The normal, of length 1 or 0.
    pub fn normal(&self) -> Vec3 {
        Vec3::from(self.normal).normalize_or_zero()
    }

    /// Texture coordinates with v down: it points up in PLY files.
    pub fn uv(&self) -> Vec2 {
        let uv = Vec2::new(self.uv[0], 1.0 - self.uv[1]);
        if uv.is_finite() { uv } else { Vec2::ZERO }
    }

    /// The colour and alpha, linear.
    pub fn colour(&self) -> Vec4 {
        srgb::decoded(self.colour)
    }
}
