//! Reads the material definitions of MTL files.

use super::super::warnings::Warnings;
use super::super::{LoadProblem, quote};
use super::{split_keyword, statements, words};
use crate::scene::recipe::OpenPbrRecipe;
use crate::scene::{Channel, Wrap};
use glam::{Vec2, Vec3};
use std::path::Path;

/// A material as its file defines it. `None` for statements that the file leaves out.
#[derive(Debug, Default)]
pub(super) struct Definition {
    pub(super) name: String,
    pub(super) kd: Option<Vec3>,
    pub(super) ks: Option<Vec3>,
    pub(super) ke: Option<Vec3>,
    /// Transmission filter.
    pub(super) tf: Option<Vec3>,
    /// Phong exponent.
    pub(super) ns: Option<f32>,
    /// Index of refraction.
    pub(super) ni: Option<f32>,
    /// Opacity.
    pub(super) d: Option<f32>,
    /// 1 − opacity. `d` takes precedence.
    pub(super) tr: Option<f32>,
    pub(super) illum: Option<u32>,
    /// Roughness.
    pub(super) pr: Option<f32>,
    /// Metallic.
    pub(super) pm: Option<f32>,
    /// Strength of the clear coat.
    pub(super) pc: Option<f32>,
    /// Roughness of the clear coat.
    pub(super) pcr: Option<f32>,
    /// Strength of the sheen.
    pub(super) ps: Option<f32>,
    /// Strength of the anisotropy.
    pub(super) aniso: Option<f32>,
    /// Rotation of the anisotropy, in turns.
    pub(super) anisor: Option<f32>,
    /// OpenPBR's parameters, if the file names any.
    pub(super) openpbr: Option<OpenPbrRecipe>,
    pub(super) map_kd: Option<Map>,
    pub(super) map_ke: Option<Map>,
    pub(super) map_d: Option<Map>,
    pub(super) map_pr: Option<Map>,
    pub(super) map_pm: Option<Map>,
    pub(super) map_bump: Option<Map>,
    pub(super) norm: Option<Map>,
}

/// A texture map with its options.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    pub(super) file: String,
    pub(super) wrap: Wrap,
    /// `-s`: how often the image repeats in the unit square.
    pub(super) scale: Vec2,
    /// `-o`: offset, added after the scale.
    pub(super) offset: Vec2,
    /// `-bm`: strength of a bump map.
    pub(super) bump: f32,
    /// `-imfchan`: the channel that a scalar is read from.
    pub(super) channel: Option<Channel>,
}

/// Parses the definitions of an MTL file, in its order.
///
/// # Errors
/// The line, and what is wrong with it.
pub(super) fn parse(
    path: &Path,
    bytes: &[u8],
    warnings: &mut Warnings,
) -> Result<Vec<Definition>, LoadProblem> {
    let mut list: Vec<Definition> = Vec::new();
    for (line, statement) in statements(&String::from_utf8_lossy(bytes)) {
        let (keyword, arguments) = split_keyword(&statement);
        let result = if keyword == "newmtl" {
            list.push(Definition { name: arguments.to_owned(), ..Definition::default() });
            Ok(())
        } else if let Some(definition) = list.last_mut() {
            definition.statement(keyword, arguments, warnings)
        } else {
            Err("a statement before the first newmtl".into())
        };
        result.map_err(|problem| LoadProblem::Line {
            path: path.to_owned(),
            line,
            problem: format!("{}: {problem}", quote(keyword)),
        })?;
    }
    Ok(list)
}

impl Definition {
    fn statement(&mut self, keyword: &str, arguments: &str, warnings: &mut Warnings) -> Result<(), String> {
        let name = &self.name;
        let mut warn = |problem: &str| warnings.add(format!("Material {name:?}: {problem}."));
        match keyword {
            "Kd" => self.kd = colour(arguments, &mut warn)?,
            "Ks" => self.ks = colour(arguments, &mut warn)?,
            "Ke" => self.ke = colour(arguments, &mut warn)?,
            "Tf" => self.tf = colour(arguments, &mut warn)?,
            "Ns" => self.ns = Some(number(arguments)?),
            "Ni" => self.ni = Some(number(arguments)?),
            "d" => {
                let opacity = arguments.strip_prefix("-halo");
                if opacity.is_some() {
                    warn("-halo of d is ignored; its factor is used as opacity");
                }
                self.d = Some(number(opacity.unwrap_or(arguments))?);
            }
            "Tr" => self.tr = Some(number(arguments)?),
            "illum" => {
                let model = number(arguments)?;
                self.illum = Some(model as u32).filter(|&index| index <= 10 && index as f32 == model);
                if self.illum.is_none() {
                    warn(&format!("illum {model} is not an illumination model (0 to 10) and is ignored"));
                }
            }
            "Pr" => self.pr = Some(number(arguments)?),
            "Pm" => self.pm = Some(number(arguments)?),
            "Pc" => self.pc = Some(number(arguments)?),
            "Pcr" => self.pcr = Some(number(arguments)?),
            "Ps" => self.ps = Some(number(arguments)?),
            "aniso" => self.aniso = Some(number(arguments)?),
            "anisor" => self.anisor = Some(number(arguments)?),
            "map_Kd" => self.map_kd = Some(map(arguments, &mut warn)?),
            "map_Ke" => self.map_ke = Some(map(arguments, &mut warn)?),
            "map_d" => self.map_d = Some(map(arguments, &mut warn)?),
            "map_Pr" => self.map_pr = Some(map(arguments, &mut warn)?),
            "map_Pm" => self.map_pm = Some(map(arguments, &mut warn)?),
            "map_Bump" | "map_bump" | "bump" => self.map_bump = Some(map(arguments, &mut warn)?),
            "norm" | "map_Kn" => self.norm = Some(map(arguments, &mut warn)?),
            // Ambient light is computed. Sharpness and antialiasing are not properties of the surface.
            "Ka" | "map_Ka" | "sharpness" | "map_aat" => {}
            _ => match keyword.strip_prefix("openpbr_") {
                Some(parameter) => {
                    let words: Vec<&str> = words(arguments).collect();
                    self.openpbr.get_or_insert_default().set(parameter, &words)?;
                }
                None => {
                    warn(&format!("the MTL statement {} is not supported and is ignored", quote(keyword)))
                }
            },
        }
        Ok(())
    }
}

/// The single number of a statement.
fn number(arguments: &str) -> Result<f32, String> {
    let word = words(arguments).next().ok_or("a number is missing")?;
    let value: f32 = word.parse().map_err(|_| format!("{} is not a number", quote(word)))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{} is not finite", quote(word))) }
}

/// `r g b`, or one number for all three. `None`, with a warning, for spectra and CIE XYZ.
fn colour(arguments: &str, warn: &mut impl FnMut(&str)) -> Result<Option<Vec3>, String> {
    if let Some(form @ ("spectral" | "xyz")) = words(arguments).next() {
        warn(&format!("colours given as {form:?} are not supported and are ignored"));
        return Ok(None);
    }
    let r = number(arguments)?;
    let rest: Vec<&str> = words(arguments).skip(1).collect();
    match rest[..] {
        [] => Ok(Some(Vec3::splat(r))),
        [g, b, ..] => Ok(Some(Vec3::new(r, number(g)?, number(b)?))),
        _ => Err("has 2 numbers; a colour needs 3, or 1 for all channels".into()),
    }
}

/// Parses options and the file name, which may contain spaces.
fn map(arguments: &str, warn: &mut impl FnMut(&str)) -> Result<Map, String> {
    let mut map = Map {
        file: String::new(),
        wrap: Wrap::Repeat,
        scale: Vec2::ONE,
        offset: Vec2::ZERO,
        bump: 1.0,
        channel: None,
    };
    let mut rest = arguments;
    while let (option, after) = split_keyword(rest)
        && option.len() > 1
        && option.starts_with('-')
    {
        rest = after;
        let mut take = || {
            let (word, after) = split_keyword(rest);
            rest = after;
            word
        };
        match option {
            "-clamp" => map.wrap = if take() == "on" { Wrap::Clamp } else { Wrap::Repeat },
            "-bm" => map.bump = number(take())?,
            "-imfchan" => {
                map.channel = match take() {
                    "r" => Some(Channel::R),
                    "g" => Some(Channel::G),
                    "b" => Some(Channel::B),
                    "m" => Some(Channel::A),
                    "l" => Some(Channel::Luminance),
                    other => return Err(format!("-imfchan {other}: channels are r, g, b, m and l")),
                }
            }
            "-s" | "-o" | "-t" => {
                let (values, after) = vector(rest, if option == "-s" { 1.0 } else { 0.0 })?;
                rest = after;
                match option {
                    "-s" => map.scale = values,
                    "-o" => map.offset = values,
                    _ => warn("turbulence (-t) of a texture is not supported and is ignored"),
                }
            }
            "-mm" => {
                let (base, gain) = (number(take())?, number(take())?);
                if (base, gain) != (0.0, 1.0) {
                    warn("range modification (-mm) of a texture is not supported and is ignored");
                }
            }
            // Filtering and storage of images. There is one filter, so these options are ignored.
            "-colorspace" => {
                let space = take();
                if !matches!(space, "auto" | "sRGB" | "srgb") {
                    warn("-colorspace of a texture is not supported and is ignored: its use decides");
                }
            }
            "-blendu" | "-blendv" | "-boost" | "-cc" | "-texres" | "-type" => _ = take(),
            _ => return Err(format!("unknown texture option {}", quote(option))),
        }
    }
    if rest.is_empty() {
        return Err("the texture's file name is missing".into());
    }
    map.file = rest.to_owned();
    Ok(map)
}

/// Parses one to three numbers. The first two are used; `missing` is the default of the second.
fn vector(arguments: &str, missing: f32) -> Result<(Vec2, &str), String> {
    let (word, mut rest) = split_keyword(arguments);
    let mut values = Vec2::new(number(word)?, missing);
    for index in 1..3 {
        let (word, after) = split_keyword(rest);
        // The last word is the file name, even if it is a number.
        let Some(value) = word.parse::<f32>().ok().filter(|_| !after.is_empty()) else { break };
        if index == 1 {
            values.y = value;
        }
        rest = after;
    }
    if values.is_finite() { Ok((values, rest)) } else { Err("a texture option is not finite".into()) }
}
