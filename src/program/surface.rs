//! Patterns: shaders that compute the finish of a surface.

use super::code::Code;
use super::lower::{Input, Output, lower};
use super::prelude::prelude;
use super::run::{BLOCK, Columns, run};
use super::source::{Fault, ShaderError, Source};
use crate::lanes::{Lanes, MAX_LANES};
use crate::scene::{
    Effects, FINISH_FIELDS, FieldType, Finish, FinishSource, POINT_FIELDS, PointSink, Points, Procedural,
};
use naga::{Expression, Literal, Scalar, ScalarKind, Span, TypeInner};
use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// The function that a pattern defines.
const ENTRY: &str = "pattern";

/// Its signature.
const SIGNATURE: &str = "fn pattern(at: Point) -> Finish";

/// The most programs whose columns a thread keeps.
const MOST_KEPT: usize = 16;

/// A parameter of a shader: an `override` of its file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// `f32`, `i32`, `u32` or `bool`.
    pub kind: &'static str,
    /// Whether it has a default, so that it need not be set.
    pub has_default: bool,
}

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
    file: String,
    /// Hash of the source, the prelude and the parameters.
    hash: u64,
    parameters: Vec<Parameter>,
    code: Code,
    /// Bit `i` is set if field `i` of points is used.
    wanted: u64,
    /// The register of each used scalar of points, and whether it is a truth value.
    inputs: Vec<Option<(u32, bool)>>,
    effects: Effects,
    /// Differs between all programs of a process.
    number: u64,
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
        Self::load_with(file, text, values, true)
    }

    /// [`PatternShader::load`]; without `natives` the functions of the prelude are computed from their WGSL.
    pub(super) fn load_with<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
        natives: bool,
    ) -> Result<Self, ShaderError> {
        static NUMBERS: AtomicU64 = AtomicU64::new(1);
        let prelude = prelude();
        let source = Source::parse(file, text, &prelude)?;
        let told = |fault: Fault| source.error(&fault);
        let parameters = parameters(&source);
        let mut overrides = BTreeMap::new();
        for (name, value) in values {
            let word = parameter_word(&source, &parameters, name, value).map_err(told)?;
            overrides.insert(name.to_owned(), word);
        }
        let entry = entry(&source).map_err(told)?;
        let Source { module, info, text: whole, .. } = &source;
        let input = Input { module, info, overrides: &overrides, natives, source: whole };
        let (code, outputs) = lower(input, entry).map_err(told)?;
        let effects = effects(&source, &outputs).map_err(told)?;
        let (wanted, inputs) = wanted(&code);
        let identity = format!("{whole}\0{overrides:?}");
        Ok(Self {
            file: file.into(),
            hash: xxh3_64(identity.as_bytes()),
            parameters,
            code,
            wanted,
            inputs,
            effects,
            number: NUMBERS.fetch_add(1, Relaxed),
        })
    }

    /// The parameters of a file's text.
    ///
    /// # Errors
    /// When the text is no valid WGSL.
    pub fn parameters_of(file: &str, text: &str) -> Result<Vec<Parameter>, ShaderError> {
        Ok(parameters(&Source::parse(file, text, &prelude())?))
    }

    /// Loads a pattern to see whether it can be loaded. Parameters without a default count as 1.
    ///
    /// # Errors
    /// Those of [`PatternShader::load`].
    pub fn check(file: &str, text: &str) -> Result<Self, ShaderError> {
        let parameters = Self::parameters_of(file, text)?;
        let needed = parameters.iter().filter(|parameter| !parameter.has_default);
        let ones =
            needed.map(|parameter| (&*parameter.name, if parameter.kind == "bool" { "true" } else { "1" }));
        Self::load(file, text, ones)
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The parameters, in the order of the file.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Number of operations that a point takes, loops counted once.
    pub fn operations(&self) -> usize {
        self.code.instructions.len()
    }
}

impl Procedural for PatternShader {
    fn effects(&self) -> Effects {
        self.effects
    }

    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        thread_local! {
            static COLUMNS: RefCell<HashMap<u64, Columns>> = RefCell::default();
        }
        let mut columns = COLUMNS.with_borrow_mut(|all| {
            if all.len() >= MOST_KEPT {
                all.clear();
            }
            all.remove(&self.number).unwrap_or_default()
        });
        columns.prepare(&self.code, self.number);
        points.write_to(self.wanted, &mut Inputs { shader: self, columns: &columns });
        if let Err(endless) = run(points.lanes(), &self.code, &columns, L::LANES) {
            endless_loop(&self.file, endless.line);
        }
        let finish = Finish::read_from(points.lanes(), &Outputs { shader: self, columns: &columns });
        COLUMNS.with_borrow_mut(|all| all.insert(self.number, columns));
        finish
    }
}

#[cold]
fn endless_loop(file: &str, line: u32) -> ! {
    panic!("{file}:{line}: this loop takes too many turns; does it end at every point?");
}

/// Writes the scalars of points into a program's registers.
struct Inputs<'a> {
    shader: &'a PatternShader,
    columns: &'a Columns,
}

impl PointSink for Inputs<'_> {
    #[inline(always)]
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]) {
        let Some((register, is_truth)) = self.shader.inputs[scalar] else { return };
        for (cell, &number) in self.columns.column(register, MAX_LANES).iter().zip(column) {
            cell.set(match is_truth {
                true if number > 0.0 => u32::MAX,
                true => 0,
                false => number.to_bits(),
            });
        }
    }
}

/// Reads the scalars of a finish from a program's registers.
struct Outputs<'a> {
    shader: &'a PatternShader,
    columns: &'a Columns,
}

impl FinishSource for Outputs<'_> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        let from = self.columns.column(self.shader.code.outputs[scalar], MAX_LANES);
        for (number, cell) in column.iter_mut().zip(from) {
            *number = f32::from_bits(cell.get());
        }
    }
}

const _: () = assert!(MAX_LANES <= BLOCK);

/// The fields of points that a program uses, and the registers of their scalars.
fn wanted(code: &Code) -> (u64, Vec<Option<(u32, bool)>>) {
    let scalars: Vec<(usize, bool)> = POINT_FIELDS
        .iter()
        .enumerate()
        .flat_map(|(field, row)| (0..row.kind.numbers()).map(move |_| (field, row.kind == FieldType::Bool)))
        .collect();
    let (mut wanted, mut inputs) = (0, vec![None; scalars.len()]);
    for &(scalar, register) in &code.inputs {
        let (field, is_truth) = scalars[scalar as usize];
        wanted |= 1 << field;
        inputs[scalar as usize] = Some((register, is_truth));
    }
    (wanted, inputs)
}

/// The parameters of a file.
fn parameters(source: &Source) -> Vec<Parameter> {
    let overrides = source.module.overrides.iter();
    overrides
        .filter_map(|(_, parameter)| {
            let kind = match source.module.types[parameter.ty].inner {
                TypeInner::Scalar(Scalar { kind: ScalarKind::Float, .. }) => "f32",
                TypeInner::Scalar(Scalar { kind: ScalarKind::Sint, .. }) => "i32",
                TypeInner::Scalar(Scalar { kind: ScalarKind::Uint, .. }) => "u32",
                TypeInner::Scalar(Scalar { kind: ScalarKind::Bool, .. }) => "bool",
                _ => return None,
            };
            let name = parameter.name.clone()?;
            Some(Parameter { name, kind, has_default: parameter.init.is_some() })
        })
        .collect()
}

/// The word of a parameter's value.
fn parameter_word(source: &Source, parameters: &[Parameter], name: &str, value: &str) -> Result<u32, Fault> {
    let Some(parameter) = parameters.iter().find(|parameter| parameter.name == name) else {
        let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        let there =
            if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) };
        return Err(Fault::new(
            Span::UNDEFINED,
            format!("the shader has no parameter `{name}`"),
            format!("{there}; `override {name}: f32 = {value};` would make it one"),
        ));
    };
    let word = match parameter.kind {
        "f32" => value.parse().ok().filter(|x: &f32| x.is_finite()).map(f32::to_bits),
        "i32" => value.parse().ok().map(|x: i32| x as u32),
        "u32" => value.parse().ok(),
        _ => value.parse().ok().map(|truth: bool| if truth { u32::MAX } else { 0 }),
    };
    let span = source.module.overrides.iter().find(|(_, other)| other.name.as_deref() == Some(name));
    let span = span.map_or(Span::UNDEFINED, |(handle, _)| source.module.overrides.get_span(handle));
    word.ok_or_else(|| {
        let message = format!("`{name}` is {value:?}, which is no {}", parameter.kind);
        Fault::new(span, message, "write a finite number, or true or false for a bool")
    })
}

/// The pattern's function.
fn entry(source: &Source) -> Result<naga::Handle<naga::Function>, Fault> {
    let module = &source.module;
    let named =
        |name: &str| module.functions.iter().find(|(_, function)| function.name.as_deref() == Some(name));
    let Some((handle, function)) = named(ENTRY) else {
        return Err(Fault::new(
            Span::UNDEFINED,
            format!("the shader has no function `{ENTRY}`"),
            format!("define `{SIGNATURE}`"),
        ));
    };
    let type_name = |ty| module.types[ty].name.as_deref();
    let arguments: Vec<_> = function.arguments.iter().map(|argument| type_name(argument.ty)).collect();
    let result = function.result.as_ref().and_then(|result| type_name(result.ty));
    if arguments != [Some("Point")] || result != Some("Finish") {
        let span = module.functions.get_span(handle);
        return Err(Fault::new(
            span,
            format!("`{ENTRY}` has another signature"),
            format!("write `{SIGNATURE}`"),
        ));
    }
    Ok(handle)
}

/// What a pattern computes beside colours.
fn effects(source: &Source, outputs: &[Output]) -> Result<Effects, Fault> {
    let scalars = |name: &str| {
        let mut first = 0;
        for field in FINISH_FIELDS {
            let end = first + field.kind.numbers();
            if field.name == name {
                return &outputs[first..end];
            }
            first = end;
        }
        &[]
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
    let mut normal = 0;
    for field in POINT_FIELDS.iter().take_while(|field| field.name != "normal") {
        normal += field.kind.numbers() as u32;
    }
    let given = |(i, output): (usize, &Output)| *output == Output::Input(normal + i as u32);
    if !scalars("normal").iter().enumerate().all(given) {
        effects = effects.normals();
    }
    if !is_always("transmission", 0.0) {
        effects = match constant(source, "ior") {
            None => effects.thin_transmission(),
            Some((ior, _)) if ior >= 1.0 && ior.is_finite() => effects.body_transmission(ior),
            Some((ior, span)) => {
                return Err(Fault::new(span, format!("`ior` is {ior}"), "write a number of at least 1"));
            }
        };
    }
    if !is_always("emission", 0.0) {
        effects = match constant(source, "max_emission") {
            Some((bound, _)) if bound > 0.0 && bound.is_finite() => effects.emission(bound),
            Some((bound, span)) => {
                return Err(Fault::new(span, format!("`max_emission` is {bound}"), "write a number above 0"));
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

/// A number that a file defines as a constant.
fn constant(source: &Source, name: &str) -> Option<(f32, Span)> {
    let module = &source.module;
    let (handle, constant) =
        module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(name))?;
    let number = match module.global_expressions[constant.init] {
        Expression::Literal(Literal::F32(x)) => x,
        Expression::Literal(Literal::AbstractFloat(x)) => x as f32,
        Expression::Literal(Literal::I32(x)) => x as f32,
        Expression::Literal(Literal::U32(x)) => x as f32,
        Expression::Literal(Literal::AbstractInt(x)) => x as f32,
        _ => f32::NAN,
    };
    Some((number, module.constants.get_span(handle)))
}
