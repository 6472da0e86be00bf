//! Patterns: shaders that compute the finish of a surface.

#[cfg(feature = "gpu")]
use super::device::Program;
use super::kernel::{Kernel, PointInputs, Signature, first_scalar, write};
use super::loaded::{Loaded, shown};
use super::lower::{Base, Lowered, Output};
use super::operation::CHUNK;
use super::parameter::Parameter;
use super::run::{BLOCK, Columns};
use super::source::{Fault, ShaderError, SourceText};
use crate::lanes::{Lanes, MAX_LANES, for_pairs_mut};
use crate::scene::{
    AttributeRequest, BlockColumns, BlockSurface, BoundTexture, Effects, FINISH_FIELDS, Finish, FinishSource,
    OwnSurface, POINT_FIELDS, Points, Procedural, ProceduralSurface, Transmission, WantedFields,
};
use naga::Span;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

const PATTERN: Signature = Signature {
    name: "pattern",
    arguments: &["Point"],
    result: "Finish",
    text: "fn pattern(at: Point) -> Finish",
};

/// Programs of fewer instructions are computed where hits are shaded: for them it costs more to read the hits twice.
const MIN_IN_BLOCKS: usize = 48;

/// A pattern in WGSL: a file with `fn pattern(at: Point) -> Finish`, computed at each hit. It is a [`Procedural`]
/// surface like those in Rust.
///
/// What a pattern computes beside colours is found by itself: opacity, normals and transmission count as computed
/// unless they are always the default. A pattern that emits light states the greatest radiance, `const max_emission =
/// 4.0;`. One that transmits is a thin wall, or with `const ior = 1.5;` the boundary of a body.
///
/// ```
/// use raystream::program::PatternShader;
/// use raystream::scene::{Material, ProceduralSurface, Scene};
///
/// let shader = PatternShader::load(
///     "stripes.wgsl",
///     "override width: f32 = 0.1;
///      fn pattern(at: Point) -> Finish {
///          var finish = matte(at);
///          finish.colour = mix(vec3f(0.1), vec3f(0.8, 0.2, 0.1), step(0.5, fract(at.position.x / width)));
///          return finish;
///      }",
///     [("width", "0.25")],
/// )?;
/// let mut scene = Scene::default();
/// scene.materials = vec![Material::matte("wall", glam::Vec3::ONE)];
/// scene.replace_surface("wall", ProceduralSurface::new(shader)).expect("there is a wall");
///
/// let error = PatternShader::load("stripes.wgsl", "fn pattern(at: Point) -> Finish { return mate(at); }", []);
/// assert!(error.unwrap_err().to_string().contains("stripes.wgsl:1:"));
/// # Ok::<(), raystream::program::ShaderError>(())
/// ```
pub struct PatternShader {
    text: Arc<SourceText>,
    hash: u64,
    parameters: Vec<Parameter>,
    kernel: Kernel,
    inputs: PointInputs,
    effects: Effects,
    /// The scalars of finishes that are read.
    read: Vec<usize>,
    block: Option<usize>,
    /// The file, if it asks for the finish of its material.
    over: Option<Arc<Loaded>>,
}

impl fmt::Debug for PatternShader {
    // The fingerprint of a scene contains this text. The file's name does not change the picture.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PatternShader")
            .field("hash", &format_args!("{:016x}", self.hash))
            .finish_non_exhaustive()
    }
}

impl PatternShader {
    /// Loads a pattern from the text of a file, whose name messages show, with values of its parameters.
    ///
    /// # Errors
    /// When the text is no valid WGSL, has no such function, uses what patterns lack, or a parameter is unknown or has
    /// no valid value. The message shows the place.
    pub fn load<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ShaderError> {
        Self::of(Loaded::new(file, text, values, true)?)
    }

    /// [`PatternShader::load`]; without `natives` the functions of the prelude are computed from their WGSL.
    #[doc(hidden)]
    pub fn load_with<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
        natives: bool,
    ) -> Result<Self, ShaderError> {
        Self::of(Loaded::new(file, text, values, natives)?)
    }

    /// [`PatternShader::load`] of a pattern with pictures: see [`super::SurfaceShader::load_with_pictures`].
    ///
    /// # Errors
    /// Those of [`PatternShader::load`], and when a picture is not bound or cannot be found.
    pub fn load_with_pictures(
        file: &str,
        text: &str,
        values: &[(&str, &str)],
        find: &mut dyn FnMut(&str) -> Result<BoundTexture, String>,
    ) -> Result<Self, ShaderError> {
        let loaded = Loaded::new(file, text, values.iter().copied(), true)?;
        Self::of(loaded.with_pictures(values, find)?)
    }

    pub(super) fn of(loaded: Loaded) -> Result<Self, ShaderError> {
        loaded.refuse_displacement()?;
        Self::lowered(&Arc::new(loaded), None)
    }

    /// The pattern as it is on a material of a surface, if that is known.
    fn lowered(loaded: &Arc<Loaded>, own: Option<&OwnSurface>) -> Result<Self, ShaderError> {
        let words: Option<Vec<Option<u32>>> =
            own.map(|own| own.constants().into_iter().map(|x| x.map(f32::to_bits)).collect());
        let base = words.as_ref().map_or(Base::Unknown, |words| Base::Of(words));
        let Lowered { code, outputs, asks_base, .. } = loaded.lower(&PATTERN, base)?;
        let effects = effects(loaded, &outputs, own).map_err(|fault| loaded.error(&fault))?;
        let kernel = Kernel::new(code, loaded.pictures()?);
        let computes = kernel.code.instructions.len() >= MIN_IN_BLOCKS;
        Ok(Self {
            text: Arc::clone(&loaded.source.text),
            hash: loaded.hash(),
            inputs: kernel.inputs_over_material(&loaded.attributes()),
            parameters: loaded.parameters.clone(),
            block: computes.then_some(BLOCK),
            kernel,
            effects,
            read: BlockColumns::computed(&effects),
            over: asks_base.then(|| Arc::clone(loaded)),
        })
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        self.text.file()
    }

    /// The parameters, in the order of the file.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// True if it asks for the finish of its material.
    #[cfg(feature = "gpu")]
    pub(super) fn asks_base(&self) -> bool {
        self.over.is_some()
    }

    /// The program, as devices compute it.
    #[cfg(feature = "gpu")]
    pub(super) fn program(&self) -> Program {
        Program { text: Arc::clone(&self.text), code: self.kernel.code.clone() }
    }

    /// Number of operations that a point takes, loops counted once.
    pub fn operations(&self) -> usize {
        self.kernel.code.instructions.len()
    }

    /// The same pattern, computed for blocks of this many hits, a multiple of 16; `None` for as many as there are
    /// lanes. The results are the same. By default short patterns are not computed in blocks.
    ///
    /// # Panics
    /// If the number is 0 or no multiple of 16.
    pub fn with_block(self, block: Option<usize>) -> Self {
        assert!(block.is_none_or(|block| block > 0 && block.is_multiple_of(CHUNK)), "a multiple of {CHUNK}");
        Self { block, ..self }
    }
}

impl Procedural for PatternShader {
    fn effects(&self) -> Effects {
        self.effects
    }

    fn starts_from_material(&self) -> bool {
        self.over.is_some()
    }

    fn textures(&self) -> &[BoundTexture] {
        self.kernel.pictures()
    }

    fn attributes(&self) -> &[AttributeRequest] {
        &self.inputs.attributes
    }

    fn reads_moment(&self) -> bool {
        self.inputs.read_moment()
    }

    fn over(&self, own: &OwnSurface) -> Result<Option<ProceduralSurface>, String> {
        let Some(loaded) = &self.over else { return Ok(None) };
        let over = Self::lowered(loaded, Some(own)).map_err(|error| error.to_string())?;
        Ok(Some(ProceduralSurface::new(over)))
    }

    fn in_blocks(&self) -> Option<&dyn BlockSurface> {
        self.block.is_some().then_some(self)
    }

    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let columns = self.kernel.columns(CHUNK);
        points.write_to(self.inputs.wanted(), &mut self.inputs.sink(&columns, L::LANES));
        self.kernel.run_vector(points.lanes(), &self.text, &columns);
        let finish = Finish::read_from(
            points.lanes(),
            &Outputs { kernel: &self.kernel, columns: &columns },
            &self.effects,
        );
        self.kernel.keep(columns);
        finish
    }
}

impl BlockSurface for PatternShader {
    fn wanted(&self) -> WantedFields<'_> {
        self.inputs.wanted()
    }

    fn block(&self) -> usize {
        self.block.unwrap_or(CHUNK)
    }

    fn compute(&self, lanes: usize, points: usize, from: &BlockColumns, to: &mut BlockColumns) {
        let block = self.block.unwrap_or(CHUNK);
        for start in (0..points).step_by(block) {
            self.compute_piece(lanes, start..points.min(start + block), from, to);
        }
    }
}

impl PatternShader {
    /// Computes at most as many points as a block has.
    fn compute_piece(&self, lanes: usize, piece: Range<usize>, from: &BlockColumns, to: &mut BlockColumns) {
        let (block, points) = (self.block.unwrap_or(CHUNK), piece.len());
        let columns = self.kernel.columns(block);
        for (scalar, input) in self.inputs.registers.iter().enumerate() {
            let Some((register, is_truth)) = *input else { continue };
            // Points beyond the piece are computed too, and loops must end for them.
            let column = columns.column(register, points.next_multiple_of(CHUNK));
            write(column, &from.column(scalar)[piece.clone()], is_truth);
        }
        self.kernel.run(lanes, &self.text, &columns, points);
        for &scalar in &self.read {
            let from = columns.operand(self.kernel.code.outputs[scalar], points);
            for (chunk, to) in to.column_mut(scalar)[piece.clone()].chunks_mut(CHUNK).enumerate() {
                let words = from.some(chunk * CHUNK, CHUNK);
                for_pairs_mut(to, words, |number, word| *number = f32::from_bits(word.get()));
            }
        }
        self.kernel.keep(columns);
    }
}

/// Reads the scalars of a finish from a program's columns.
struct Outputs<'a> {
    kernel: &'a Kernel,
    columns: &'a Columns,
}

impl FinishSource for Outputs<'_> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        let from = self.columns.operand(self.kernel.code.outputs[scalar], CHUNK);
        for_pairs_mut(column, from.some(0, CHUNK), |number, word| *number = f32::from_bits(word.get()));
    }
}

const _: () = assert!(MAX_LANES == CHUNK && BLOCK.is_multiple_of(CHUNK));

/// Effects that a pattern computes beside colours.
fn effects(loaded: &Loaded, outputs: &[Output], own: Option<&OwnSurface>) -> Result<Effects, Fault> {
    let scalars = |name: &str| {
        let first = first_scalar(FINISH_FIELDS, name);
        let field = FINISH_FIELDS.iter().find(|field| field.name == name);
        &outputs[first..first + field.map_or(0, |field| field.kind.numbers())]
    };
    let is_always = |name: &str, number: f32| {
        scalars(name)
            .iter()
            .all(|output| matches!(output, Output::Known(word) if f32::from_bits(*word) == number))
    };
    let mut effects = Effects::default();
    if !is_always("opacity", 1.0) {
        effects = effects.opacity();
    }
    let normal = first_scalar(POINT_FIELDS, "normal") as u32;
    let given = |(i, output): (usize, &Output)| *output == Output::Input(normal + i as u32);
    if !scalars("normal").iter().enumerate().all(given) {
        effects = effects.normals();
    }
    if !is_always("transmission", 0.0) {
        effects = match loaded.ior()? {
            None => {
                let own = own.and_then(OwnSurface::transmission);
                Effects { transmission: Some(own.unwrap_or(Transmission::ThinWall)), ..effects }
            }
            Some(ior) => effects.body_transmission(ior),
        };
    }
    effects.has_anisotropy = !is_always("anisotropy", 0.0);
    effects.has_sheen = !is_always("sheen", 0.0);
    effects.has_film = !is_always("film", 0.0);
    effects.has_diffuse_transmission = !is_always("diffuse_transmission", 0.0);
    if !is_always("emission", 0.0) {
        effects = match loaded.constant("max_emission") {
            Some((bound, _)) if bound > 0.0 && bound.is_finite() => effects.emission(bound),
            Some((bound, span)) => {
                return Err(Fault::new(
                    span,
                    format!("`max_emission` is {}", shown(bound)),
                    "write a number above 0",
                ));
            }
            None => {
                return Err(Fault::new(
                    Span::UNDEFINED,
                    "the pattern emits light without saying how much at most",
                    "add `const max_emission = 10.0;` with the greatest radiance of any channel",
                ));
            }
        };
    }
    Ok(effects)
}
