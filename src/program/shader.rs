//! Shaders of surfaces, of whatever kind a file defines.

use super::bsdf::{self, BsdfShader};
use super::integrator::IntegratorShader;
use super::loaded::Loaded;
use super::parameter::Parameter;
use super::source::ShaderError;
use super::surface::PatternShader;
use crate::scene::{
    AttributeRequest, BoundTexture, CodedSurface, Procedural, ProceduralSurface, Scattering,
    ScatteringSurface,
};

/// A shader of a surface: a pattern, or a BSDF if the file defines `evaluate` or `sample`.
#[derive(Debug)]
#[non_exhaustive]
#[allow(clippy::large_enum_variant, reason = "few exist")]
pub enum SurfaceShader {
    /// `fn pattern(at: Point) -> Finish`
    Pattern(PatternShader),
    /// `prepare`, `evaluate` and `sample`.
    Bsdf(BsdfShader),
}

impl SurfaceShader {
    /// Loads a shader from the text of a file, whose name messages show, with values of its parameters.
    ///
    /// # Errors
    /// Those of [`PatternShader::load`] and [`BsdfShader::load`].
    pub fn load<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ShaderError> {
        check_kind(file, text)?;
        Self::of(Loaded::new(file, text, values, true)?)
    }

    /// [`SurfaceShader::load`] of a shader with pictures. `find` is given the value of each and returns the texture
    /// that it names, or says why there is none.
    ///
    /// ```
    /// use raystream::program::SurfaceShader;
    /// use raystream::scene::{BoundTexture, ColourSpace, Texture, Wrap};
    ///
    /// let red = Texture {
    ///     name: "red".into(),
    ///     width: 1,
    ///     height: 1,
    ///     texels: [[255, 0, 0, 255]].into(),
    ///     space: ColourSpace::Srgb,
    ///     wrap_u: Wrap::Repeat,
    ///     wrap_v: Wrap::Repeat,
    ///     mipmap: Default::default(),
    /// };
    /// let text = "var paint: texture_2d<f32>;
    ///     fn pattern(at: Point) -> Finish {
    ///         var finish = matte(at);
    ///         finish.colour = image(paint, at.uv).rgb;
    ///         return finish;
    ///     }";
    /// let mut find = |_: &str| Ok(BoundTexture::new(red.clone()));
    /// SurfaceShader::load_with_pictures("paint.wgsl", text, &[("paint", "red")], &mut find)?;
    /// let error = SurfaceShader::load("paint.wgsl", text, []).unwrap_err();
    /// assert_eq!(error.message, "the picture `paint` is not bound");
    /// # Ok::<(), raystream::program::ShaderError>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`SurfaceShader::load`], and when a picture is not bound or cannot be found.
    pub fn load_with_pictures(
        file: &str,
        text: &str,
        values: &[(&str, &str)],
        find: &mut dyn FnMut(&str) -> Result<BoundTexture, String>,
    ) -> Result<Self, ShaderError> {
        check_kind(file, text)?;
        let loaded = Loaded::new(file, text, values.iter().copied(), true)?;
        Self::of(loaded.with_pictures(values, find)?)
    }

    /// Loads a shader to see whether it can be loaded. Parameters without a default count as 1, pictures as white.
    ///
    /// # Errors
    /// Those of [`SurfaceShader::load`].
    pub fn check(file: &str, text: &str) -> Result<Self, ShaderError> {
        check_kind(file, text)?;
        Self::of(Loaded::with_ones(file, text)?)
    }

    fn of(loaded: Loaded) -> Result<Self, ShaderError> {
        if bsdf::FUNCTIONS.iter().any(|function| loaded.has(function)) {
            return BsdfShader::of(loaded).map(Self::Bsdf);
        }
        PatternShader::of(loaded).map(Self::Pattern)
    }

    /// The parameters of a file's text.
    ///
    /// # Errors
    /// When the text is no valid WGSL.
    pub fn parameters_of(file: &str, text: &str) -> Result<Vec<Parameter>, ShaderError> {
        Ok(Loaded::new(file, text, [], true)?.parameters)
    }

    /// The parameters, in the order of the file.
    pub fn parameters(&self) -> &[Parameter] {
        match self {
            Self::Pattern(pattern) => pattern.parameters(),
            Self::Bsdf(bsdf) => bsdf.parameters(),
        }
    }

    /// The vertex attributes that it reads.
    pub fn attributes(&self) -> &[AttributeRequest] {
        match self {
            Self::Pattern(pattern) => pattern.attributes(),
            Self::Bsdf(bsdf) => bsdf.attributes(),
        }
    }

    /// Description for people: the shader's kind and its numbers of operations.
    pub fn description(&self) -> String {
        match self {
            Self::Pattern(pattern) => format!("a pattern of {} operations", pattern.operations()),
            Self::Bsdf(bsdf) => {
                let [evaluate, sample] = bsdf.operations();
                let coat = if bsdf.is_coated() { ", under a clear coat" } else { "" };
                format!(
                    "a BSDF of {evaluate} (evaluate) and {sample} (sample) operations, each with prepare{coat}"
                )
            }
        }
    }
}

/// Refuses an integrator.
fn check_kind(file: &str, text: &str) -> Result<(), ShaderError> {
    match IntegratorShader::is_integrator(text) {
        true => Err(ShaderError::of_file(
            file,
            "this is an integrator, and no shader of a surface",
            "choose it for the whole picture: `--integrator FILE.wgsl`",
        )),
        false => Ok(()),
    }
}

// Both are compiled here, not in each crate that has a shader.
impl From<PatternShader> for ProceduralSurface {
    #[inline(never)]
    fn from(pattern: PatternShader) -> Self {
        Self::new(pattern)
    }
}

impl From<BsdfShader> for ScatteringSurface {
    #[inline(never)]
    fn from(bsdf: BsdfShader) -> Self {
        Self::new(bsdf)
    }
}

impl From<SurfaceShader> for CodedSurface {
    fn from(shader: SurfaceShader) -> Self {
        match shader {
            SurfaceShader::Pattern(pattern) => ProceduralSurface::from(pattern).into(),
            SurfaceShader::Bsdf(bsdf) => ScatteringSurface::from(bsdf).into(),
        }
    }
}
