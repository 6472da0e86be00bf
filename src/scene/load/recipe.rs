//! Recipes: their text, and the scene that they generate.

use super::super::Scene;
use super::super::recipe::{Recipe, RecipeError};
use super::session::Session;
use super::{LoadProblem, check_text};

/// Loads a recipe and generates its scene.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    let path = session.path.clone();
    let bytes = session.read()?;
    check_text(&path, &bytes)?;
    let recipe = Recipe::parse(&String::from_utf8_lossy(&bytes));
    let scene = recipe.and_then(|recipe| recipe.build_with(session.options.memory));
    let mut scene = scene.map_err(|error| match error {
        RecipeError::Memory(source) => LoadProblem::Memory { path, source },
        error => LoadProblem::File { path, problem: error.to_string() },
    })?;
    for warning in std::mem::take(&mut scene.warnings) {
        session.warnings.add(warning);
    }
    Ok(scene)
}
