//! Integrators in WGSL: what becomes of the light along rays.
//!
//! A file has `fn hit`, `fn miss` and, if it pushes entries on the loop stack, `fn resume`. Where `hit` calls `trace`,
//! `split` makes a loop shader of the rest of the function. All pieces run in lanes, over blocks of points that wait
//! for the same piece.

mod function;
mod hit_fields;
mod piece;
mod signature;
mod split;
#[cfg(test)]
mod tests;
mod unweighted;

pub use function::{Host, HostCall, HostFunction};
pub use hit_fields::{HIT_FIELDS, HitFact, HitField};
pub use piece::{Piece, PieceColumns};

use super::kernel::stop;
use super::loaded::Loaded;
use super::lower::{Base, Counts, HostInput, Input, Lowered, Output, lowered};
use super::parameter::Parameter;
use super::prelude::prelude;
pub use super::run::Columns;
use super::source::{Fault, ShaderError, Source, SourceText};
use super::token::declares;
use naga::{Function, Handle, Span};
use split::{MOST_TRACES, Rest, split, traces};
use std::fmt;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// The functions of the prelude for integrators.
const FUNCTIONS: &str = include_str!("../../../shaders/integrator.wgsl");

/// The most bytes of a payload.
pub const MOST_PAYLOAD_BYTES: usize = 32;

/// The most bytes of a loop entry's own data.
pub const MOST_ENTRY_BYTES: usize = 240;

/// The most loop shaders.
const MOST_LOOPS: usize = 250;

/// The most turns that `max_turns` may allow.
const MOST_TURNS: f32 = 255.0;

/// An integrator in WGSL: a file with `fn hit(at: Hit, p: Payload)` and `fn miss(direction: vec3f, p: Payload)`.
///
/// ```
/// use raystream::program::integrator::IntegratorShader;
///
/// let shader = IntegratorShader::load(
///     "mirrors.wgsl",
///     "fn hit(at: Hit, p: Payload) -> vec3f {
///          let ways = bsdf_ways();
///          return at.emitted + ways.reflection * trace(ways.reflected, p);
///      }
///      fn miss(direction: vec3f, p: Payload) -> vec3f { return sky(direction); }",
///     [],
/// )?;
/// assert_eq!(shader.loop_shaders().len(), 1);
/// # Ok::<(), raystream::program::ShaderError>(())
/// ```
pub struct IntegratorShader {
    text: Arc<SourceText>,
    /// Hash of the source, the prelude and the parameters.
    hash: u64,
    parameters: Vec<Parameter>,
    /// The payload of camera rays.
    start: Vec<u32>,
    hit: Piece,
    miss: Piece,
    loops: Vec<Piece>,
    /// The loop shader that is `resume`.
    resume: Option<u32>,
    counts: Counts,
    /// The most splats and shadow rays of a call with what follows it at once.
    additions: u64,
    /// The most turns of an entry.
    turns: u32,
    returns: bool,
    /// True if rays wait on the loop stack.
    keeps_rays: bool,
    mirror_below: Option<f32>,
    warnings: Vec<ShaderError>,
}

impl fmt::Debug for IntegratorShader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("IntegratorShader")
            .field("hash", &format_args!("{:016x}", self.hash))
            .finish_non_exhaustive()
    }
}

impl IntegratorShader {
    /// Loads an integrator from the text of a file, whose name messages show, with values of its parameters.
    ///
    /// # Errors
    /// When the text is no valid WGSL, lacks a function or gives it another signature, uses what integrators lack, or a
    /// parameter is unknown or has no valid value. The message shows the place.
    pub fn load<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ShaderError> {
        check_kind(file, text)?;
        Self::of(&Loaded::before(&prelude_for(text), file, text, values, true)?)
    }

    fn of(loaded: &Loaded) -> Result<Self, ShaderError> {
        let loader = Loader { loaded, loops: Vec::new() };
        loader.load().map_err(|fault| loaded.error(&fault))
    }

    /// The parameters of a file's text.
    ///
    /// # Errors
    /// When the text is no valid WGSL.
    pub fn parameters_of(file: &str, text: &str) -> Result<Vec<Parameter>, ShaderError> {
        Ok(Loaded::before(&prelude_for(text), file, text, [], true)?.parameters)
    }

    /// Loads an integrator to see whether it can be loaded. Parameters without a default count as 1.
    ///
    /// # Errors
    /// Those of [`IntegratorShader::load`].
    pub fn check(file: &str, text: &str) -> Result<Self, ShaderError> {
        check_kind(file, text)?;
        Self::of(&Loaded::before(&prelude_for(text), file, text, [], true)?.ones())
    }

    /// True if a file's text is an integrator: it defines `fn hit`.
    pub fn is_integrator(text: &str) -> bool {
        declares(text, "fn", "hit")
    }

    /// A hash of a file's text and the prelude, without values of parameters.
    pub fn source_hash(text: &str) -> u64 {
        xxh3_64(format!("{text}\n{}", prelude_for(text)).as_bytes())
    }

    /// The file's name.
    #[inline]
    pub fn file(&self) -> &str {
        self.text.file()
    }

    /// A hash of the source, the prelude and the parameters.
    pub fn hash(&self) -> u64 {
        self.hash
    }

    /// Stops the job because the entry that a call pushes has been pushed too often.
    #[cold]
    pub fn stop_turning(&self, place: u32) -> ! {
        let message =
            format!("an entry is pushed again more than {} times, which `max_turns` allows", self.turns);
        let fault =
            Fault::new(Span::new(place, place + 1), message, "push it less often, or raise `max_turns`");
        stop(self.text.error(&fault))
    }

    /// The parameters, in the order of the file.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// What is valid and probably not meant.
    pub fn warnings(&self) -> &[ShaderError] {
        &self.warnings
    }

    /// The words of the payload of camera rays, at most [`MOST_PAYLOAD_BYTES`].
    pub fn start(&self) -> &[u32] {
        &self.start
    }

    /// The hit shader.
    #[inline]
    pub fn hit(&self) -> &Piece {
        &self.hit
    }

    /// The miss shader.
    #[inline]
    pub fn miss(&self) -> &Piece {
        &self.miss
    }

    /// The loop shaders: `resume`, and the rests of functions behind their calls of `trace`.
    #[inline]
    pub fn loop_shaders(&self) -> &[Piece] {
        &self.loops
    }

    /// The loop shader that is `resume`.
    #[inline]
    pub fn resume(&self) -> Option<u32> {
        self.resume
    }

    /// The most words of a loop entry.
    pub fn entry_words(&self) -> usize {
        let words = |piece: &Piece| piece.words() + piece.truths().div_ceil(32);
        self.loops.iter().map(words).max().unwrap_or(0)
    }

    /// The most times that an entry is pushed again by `resume`.
    #[inline]
    pub fn turns(&self) -> u32 {
        self.turns
    }

    /// True if functions return radiance. What the camera ray's `hit` or `miss` returns is added to the pixel.
    #[inline]
    pub fn returns(&self) -> bool {
        self.returns
    }

    /// True if a call may spawn several rays, so that some wait on the loop stack.
    pub fn keeps_rays(&self) -> bool {
        self.keeps_rays
    }

    /// Reflections of a lower perceptual roughness are mirrors, and bodies are clear; `None` if only smooth surfaces
    /// count as such.
    pub fn mirror_below(&self) -> Option<f32> {
        self.mirror_below
    }

    /// The most shadow rays of a call with what follows it at once.
    pub fn shadow_rays(&self) -> usize {
        self.counts.shadows as usize
    }

    /// The most rays that follow a ray directly.
    pub fn rays(&self) -> usize {
        self.counts.rays as usize
    }

    /// The most entries and waiting rays that a ray leaves on the loop stack.
    pub fn entries(&self) -> usize {
        // A point asks one question at a time.
        (self.counts.entries + self.counts.rays + self.counts.questions.min(1)) as usize
    }

    /// True if it asks whether rays hit nothing.
    #[inline]
    pub fn asks_questions(&self) -> bool {
        self.counts.questions > 0
    }

    /// The most splats of a sample, shadow rays included.
    pub fn splats(&self, max_bounces: u32) -> u64 {
        let calls = match self.counts.rays {
            0 => 1,
            1 => u64::from(max_bounces) + 1,
            rays => rays.saturating_pow(max_bounces + 1),
        };
        calls.saturating_mul(self.additions.max(1)).saturating_add(u64::from(self.returns))
    }
}

/// Refuses a shader of a surface.
fn check_kind(file: &str, text: &str) -> Result<(), ShaderError> {
    let is_surface = ["pattern", "evaluate"].iter().any(|name| declares(text, "fn", name));
    match is_surface && !declares(text, "fn", "hit") {
        true => Err(ShaderError::of_file(
            file,
            "this is a shader of a surface, and no integrator",
            "give it to a material: `--surface MATERIAL=FILE.wgsl`",
        )),
        false => Ok(()),
    }
}

/// The prelude of integrators, with a payload and an entry if the file has none.
fn prelude_for(text: &str) -> String {
    let mut all = prelude() + &hit_fields::text() + FUNCTIONS;
    if !declares(text, "struct", "Payload") {
        all += "\n// What travels with a ray, if a file defines nothing else.\n";
        all += "struct Payload {\n    nothing: u32,\n}\n";
    }
    if declares(text, "struct", "Entry") {
        all += "\n// Keeps an entry on the loop stack until the paths of all rays that follow have ended.\n";
        all += "fn push(entry: Entry) {}\n";
    }
    all
}

/// The prelude of integrators as files with a payload and an entry of their own see it.
pub fn integrator_prelude() -> String {
    prelude_for("struct Payload struct Entry")
}

/// A file that is being loaded.
struct Loader<'m> {
    loaded: &'m Loaded,
    loops: Vec<Piece>,
}

impl Loader<'_> {
    fn load(mut self) -> Result<IntegratorShader, Fault> {
        let found = signature::find(&self.loaded.source)?;
        let start = self.start(found.start, found.payload)?;
        let turns = self.turns()?;
        let payload = found.payload;
        let (resume, kept, resumes) = match found.resume {
            Some((function, entry)) => self.resume(function, entry, payload, turns)?,
            None => (None, Vec::new(), Counts::default()),
        };
        let (lowered, span) = self.lowered(found.hit, &kept, payload, true, found.resume.is_some())?;
        let mut counts = lowered.counts;
        let warnings = match found.returns {
            true => self.warnings(&lowered, payload),
            false => Vec::new(),
        };
        let (whole, rests) = self.parts(lowered, span)?;
        let hit = self.piece(whole, rests, span)?;
        let (lowered, span) = self.lowered(found.miss, &kept, payload, false, found.resume.is_some())?;
        let (hits, misses) = (counts, lowered.counts);
        counts = counts.most(misses);
        let (whole, rests) = self.parts(lowered, span)?;
        let miss = self.piece(whole, rests, span)?;
        let keeps_rays = counts.most(resumes).rays > 1;
        let again = counts.entries.saturating_mul(u64::from(turns) + 1);
        let followed = |calls: u64, resumed: u64| calls.saturating_add(again.saturating_mul(resumed));
        let additions = followed(hits.additions().max(misses.additions()), resumes.additions());
        counts.rays = followed(counts.rays, resumes.rays);
        counts.shadows = followed(counts.shadows, resumes.shadows);
        counts.questions = counts.questions.max(resumes.questions);
        let mirror_below = self.mirror_below()?;
        Ok(IntegratorShader {
            text: Arc::clone(&self.loaded.source.text),
            hash: self.loaded.hash(),
            parameters: self.loaded.parameters.clone(),
            start,
            hit,
            miss,
            loops: self.loops,
            resume,
            counts,
            additions,
            turns,
            returns: found.returns,
            keeps_rays,
            mirror_below,
            warnings,
        })
    }

    /// Loads `resume`: its number, the scalars of entry and payload that it reads, and its effects.
    fn resume(
        &mut self,
        function: Handle<Function>,
        entry: u32,
        payload: u32,
        turns: u32,
    ) -> Result<(Option<u32>, Vec<u32>, Counts), Fault> {
        // First with all scalars, to see which are read.
        let all: Vec<u32> = (0..entry + payload).collect();
        let (read, _) = self.lowered(function, &all, payload, false, turns > 0)?;
        let code = read.code.without_dead_instructions();
        // Inputs: entry, answer, payload.
        let read: Vec<u32> = code.inputs.iter().map(|&(input, _)| input).collect();
        let is_read = |at: &u32| read.contains(&if *at < entry { *at } else { *at + 3 });
        let kept: Vec<u32> = all.into_iter().filter(is_read).collect();
        let (lowered, span) = self.lowered(function, &kept, payload, false, turns > 0)?;
        let counts = lowered.counts;
        check_turns(&lowered, span)?;
        let (mut whole, rests) = self.parts(lowered, span)?;
        let words = kept.len() as u32;
        let place = |scalar: u32| kept.iter().position(|&at| at == scalar).map(|at| at as u32);
        let number = |input: u32| match input {
            input if input < entry => place(input),
            input if input < entry + 3 => Some(words + input - entry),
            input => place(input - 3),
        };
        let inputs = whole.code.inputs.iter();
        whole.code.inputs = inputs.filter_map(|&(input, to)| Some((number(input)?, to))).collect();
        let piece = self.piece(whole, rests, span)?.with_words(kept.len());
        self.loops.push(piece);
        Ok((Some(self.loops.len() as u32 - 1), kept, counts))
    }

    fn input<'a>(&'a self, host: Option<HostInput<'a>>) -> Input<'a> {
        let Source { module, info, text } = &self.loaded.source;
        let overrides = &self.loaded.overrides;
        Input { module, info, overrides, natives: true, text, host, base: Base::Refused, finishes: None }
    }

    fn lowered(
        &self,
        function: Handle<Function>,
        kept: &[u32],
        payload: u32,
        has_hit: bool,
        may_push: bool,
    ) -> Result<(Lowered, Span), Fault> {
        let host = HostInput { kept, payload, has_hit, may_push };
        let span = self.loaded.source.module.functions.get_span(function);
        Ok((lowered(self.input(Some(host)), &[function]).map_err(|fault| fault.at(span))?, span))
    }

    /// The payload of camera rays.
    fn start(&self, function: Option<Handle<Function>>, payload: u32) -> Result<Vec<u32>, Fault> {
        let Some(function) = function else { return Ok(vec![0; payload as usize]) };
        let Lowered { code, outputs, .. } = lowered(self.input(None), &[function])?;
        let known = |output: &Output| match output {
            Output::Known(word) => Some(*word),
            _ => None,
        };
        if let Some(words) = outputs.iter().map(known).collect() {
            return Ok(words);
        }
        let rest = Rest { code: code.without_dead_instructions().with_few_registers(), ..Rest::default() };
        let piece = Piece::new(rest, Vec::new());
        let columns: Columns = PieceColumns::default().take(&piece);
        let span = self.loaded.source.module.functions.get_span(function);
        piece.run_alone(&columns).map_err(|_| {
            Fault::new(span, "a loop of `start` takes too many turns", "give the loop an end")
        })?;
        Ok((0..payload as usize).map(|word| piece.result(&columns, word, 0)).collect())
    }

    fn parts(&self, lowered: Lowered, span: Span) -> Result<(Rest, Vec<Rest>), Fault> {
        if traces(&lowered.code) > MOST_TRACES {
            return Err(Fault::new(
                span,
                format!("loops unrolled, `trace` and `visible` are called more than {MOST_TRACES} times"),
                "give the loops fewer turns",
            ));
        }
        split(lowered.code, lowered.waiting).map_err(|needs| {
            let name = needs.function.name();
            Fault::new(
                Span::new(needs.place, needs.place + name.len() as u32),
                format!(
                    "`{name}` asks for the surface behind a call of `trace` or `visible` on whose answer it depends"
                ),
                "ask for what does not depend on the answer, and choose among the results afterwards",
            )
        })
    }

    /// A piece of a function, after its loop shaders.
    fn piece(&mut self, whole: Rest, rests: Vec<Rest>, span: Span) -> Result<Piece, Fault> {
        let first = self.loops.len() as u32;
        let mut count = 0;
        let numbers: Vec<Option<u32>> = rests
            .iter()
            .map(|rest| {
                (!rest.is_nothing).then(|| {
                    count += 1;
                    first + count - 1
                })
            })
            .collect();
        for rest in rests.into_iter().filter(|rest| !rest.is_nothing) {
            let bytes = 4 * (rest.words.len() + rest.truths.len().div_ceil(32));
            if bytes > MOST_ENTRY_BYTES {
                return Err(too_large(
                    "what lives on behind a call of `trace` or `visible`",
                    bytes,
                    MOST_ENTRY_BYTES,
                    span,
                ));
            }
            self.loops.push(Piece::new(rest, numbers.clone()));
        }
        if self.loops.len() > MOST_LOOPS {
            return Err(Fault::new(span, "there are too many loop shaders", "call `trace` less often"));
        }
        Ok(Piece::new(whole, numbers))
    }

    /// Warnings of what a recursive `hit` adds to the pixel without a weight.
    fn warnings(&self, hit: &Lowered, payload: u32) -> Vec<ShaderError> {
        let told = |(function, place): (HostFunction, u32)| {
            let name = function.name();
            let remedy = match function {
                HostFunction::Shadow => "multiply what `hit` returns by `visible(ray)`",
                _ => "return it",
            };
            self.loaded.error(&Fault::new(
                Span::new(place, place + name.len() as u32),
                format!("`{name}` adds to the pixel without the weights of the `trace`s that have led here"),
                format!("{remedy}, or carry the weight in the payload"),
            ))
        };
        unweighted::unweighted(&hit.code, payload).into_iter().map(told).collect()
    }

    fn turns(&self) -> Result<u32, Fault> {
        match self.loaded.constant("max_turns") {
            None => Ok(0),
            Some((turns, _)) if (0.0..=MOST_TURNS).contains(&turns) && turns.fract() == 0.0 => {
                Ok(turns as u32)
            }
            Some((turns, span)) => Err(Fault::new(
                span,
                format!("`max_turns` is {turns}"),
                format!("write a whole number from 0 to {MOST_TURNS}"),
            )),
        }
    }

    fn mirror_below(&self) -> Result<Option<f32>, Fault> {
        match self.loaded.constant("mirror_below") {
            None => Ok(None),
            Some((roughness, _)) if (0.0..=1.0).contains(&roughness) => Ok(Some(roughness)),
            Some((roughness, span)) => Err(Fault::new(
                span,
                format!("`mirror_below` is {roughness}"),
                "write a perceptual roughness from 0 to 1",
            )),
        }
    }
}

fn too_large(what: &str, bytes: usize, most: usize, span: Span) -> Fault {
    Fault::new(span, format!("{what} has {bytes} bytes; at most {most} fit"), "keep fewer values")
}

/// Refuses what would let loop stacks grow without end.
fn check_turns(resume: &Lowered, span: Span) -> Result<(), Fault> {
    if resume.counts.entries > 1 {
        return Err(Fault::new(
            span,
            "`resume` pushes more than one entry, so stacks would grow without end",
            "push one entry, with what it still has to do",
        ));
    }
    Ok(())
}
