//! `raystream shaders`.

use super::args::ShadersCommand;
use anyhow::Result;
use raystream::picture::shaders::read;
use raystream::program::integrator::{IntegratorShader, integrator_prelude};
use raystream::program::{Parameter, SurfaceShader};

/// `raystream shaders`.
pub fn run(command: &ShadersCommand) -> Result<()> {
    match command {
        ShadersCommand::Prelude => stdout_line!("{}", integrator_prelude().trim_end()),
        ShadersCommand::Check { files } => {
            for file in files {
                let shown = file.display().to_string();
                let text = read(file)?;
                let parameters = if IntegratorShader::is_integrator(&text) {
                    check_integrator(&shown, &text)?
                } else {
                    let shader = SurfaceShader::check(&shown, &text)?;
                    stdout_line!("{shown}: {}", shader.description());
                    shader.parameters().to_vec()
                };
                for parameter in parameters {
                    let must = if parameter.has_default { "" } else { ", must be set" };
                    stdout_line!("  {}: {}{must}", parameter.name, parameter.kind);
                }
            }
        }
    }
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
