//! `raystream shaders`.

use super::args::ShadersCommand;
use super::outputs::Outputs;
use anyhow::{Result, bail, ensure};
use raystream::engine::Units;
use raystream::film::{Look, View, WriteOptions, write_picture};
use raystream::picture::shaders::read;
use raystream::picture::{Registry, RenderSpec, open_scene};
use raystream::program::integrator::{IntegratorShader, integrator_prelude};
use raystream::program::{Parameter, SurfaceShader};
use raystream::scene::recipe::Recipe;
use raystream::scene::{AttributeRequest, CodedSurface, ScatteringSurface};
use raystream::schedule::{Service, ServiceOptions};
use std::path::{Path, PathBuf};

/// A ball where light arrives from everywhere.
const FURNACE: &str = r#"{ "environment": [0.5, 0.5, 0.5],
    "materials": { "ball": { "colour": [1, 1, 1] } },
    "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 96, "material": "ball" } ] }"#;

/// The picture of it.
const FURNACE_SPEC: &str = r#"{ "size": [192, 192], "spp": 64, "eye": [0, 0, 5], "target": [0, 0, 0],
    "fov": 30, "max-bounces": 32 }"#;

/// `raystream shaders`.
pub fn run(command: &ShadersCommand) -> Result<()> {
    match command {
        ShadersCommand::Prelude => stdout_line!("{}", integrator_prelude().trim_end()),
        ShadersCommand::Check { files, furnace } => {
            let furnace = furnace.as_deref();
            ensure!(furnace.is_none() || files.len() == 1, "--furnace shows the surface of one file");
            Outputs::check([("--furnace", furnace)], [("the shader", files.first().map(PathBuf::as_path))])?
                .make_folders()?;
            let mut broken = Vec::new();
            for file in files {
                broken.extend(check(file, furnace)?);
            }
            if !broken.is_empty() {
                bail!("{}", broken.join("\n"));
            }
        }
    }
    Ok(())
}

/// Checks a file and tells what it is. Returns the promises that it breaks.
fn check(file: &Path, furnace: Option<&Path>) -> Result<Vec<String>> {
    let shown = file.display().to_string();
    let text = read(file)?;
    if IntegratorShader::is_integrator(&text) {
        ensure!(furnace.is_none(), "{shown} is an integrator, and --furnace shows surfaces");
        list(&check_integrator(&shown, &text)?);
        return Ok(Vec::new());
    }
    let shader = SurfaceShader::check(&shown, &text)?;
    stdout_line!("{shown}: {}", shader.description());
    list(shader.parameters());
    for AttributeRequest { name, width } in shader.attributes() {
        let kind = if *width == 1 { "f32".to_owned() } else { format!("vec{width}f") };
        stdout_line!("  {name}: {kind}, of the mesh");
    }
    let mut broken = Vec::new();
    let surface = match shader {
        SurfaceShader::Bsdf(bsdf) => {
            let surface = ScatteringSurface::from(bsdf);
            let report = surface.measure();
            let [least, most] = report.albedo;
            stdout_line!(
                "  of light from everywhere, {least:.3} to {most:.3} leaves, by direction and channel"
            );
            broken.extend(report.faults.iter().map(|fault| format!("{shown}: {fault}")));
            CodedSurface::from(surface)
        }
        pattern => pattern.into(),
    };
    if let Some(picture) = furnace {
        write_furnace(surface, picture)?;
        stdout_line!("  {}: the ball in the furnace", picture.display());
    }
    Ok(broken)
}

/// Lists parameters.
fn list(parameters: &[Parameter]) {
    for parameter in parameters {
        let must = match (parameter.has_default, parameter.is_picture()) {
            (true, _) => "",
            (false, true) => ", must be bound",
            (false, false) => ", must be set",
        };
        stdout_line!("  {}: {}{must}", parameter.name, parameter.kind);
    }
}

/// Renders the furnace with a surface.
fn write_furnace(surface: CodedSurface, picture: &Path) -> Result<()> {
    let spec: RenderSpec = serde_json::from_str(FURNACE_SPEC)?;
    let mut scene = Recipe::parse(FURNACE)?.build()?;
    scene.replace_surface("ball", surface)?;
    let rendering = open_scene(&spec, scene, &Units::cpu(), &Registry::built_in())?;
    let rendered = rendering.render(&Service::new(ServiceOptions::default())?, 0)?;
    let look = Look::default().with_view(View::Standard);
    write_picture(picture, &rendered, &look, &WriteOptions::default())?;
    Ok(())
}

/// Tells what an integrator consists of.
fn check_integrator(shown: &str, text: &str) -> Result<Vec<Parameter>> {
    let shader = IntegratorShader::check(shown, text)?;
    shader.warnings().iter().for_each(|warning| log::warn!("{warning}"));
    let (hit, miss) = (shader.hit().operations(), shader.miss().operations());
    let payload = 4 * shader.start().len();
    stdout_line!(
        "{shown}: an integrator; hit takes {hit} operations, miss {miss}; its payload has {payload} bytes"
    );
    for (number, piece) in shader.loop_shaders().iter().enumerate() {
        let what = match shader.resume() == Some(number as u32) {
            true => "resume".to_owned(),
            false => format!("loop shader {number}"),
        };
        let bytes = piece.entry_bytes();
        stdout_line!("  {what} takes {} operations; its entry keeps {bytes} bytes", piece.operations());
    }
    Ok(shader.parameters().to_vec())
}
