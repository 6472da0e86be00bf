//! BSDFs in WGSL.

use super::attribute::FIRST_INPUT;
use super::code::Register;
#[cfg(feature = "gpu")]
use super::device::Program;
use super::finish_call::FinishPlace;
use super::kernel::{Kernel, PointInputs, Signature};
use super::loaded::Loaded;
use super::lower::{Base, Lowered};
use super::operation::CHUNK;
use super::parameter::Parameter;
use super::source::{ShaderError, SourceText};
use crate::lanes::{Lanes, Num, OutlinedTask, Vector, for_pairs_mut};
use crate::scene::{
    AttributeRequest, BlockColumns, BoundTexture, OwnSurface, Points, Scattered, Scattering,
    ScatteringSurface, Transmission,
};
use crate::shade::bsdf::ClearCoat;
use std::fmt;
use std::sync::Arc;

const PREPARE: Signature = Signature {
    name: "prepare",
    arguments: &["Point"],
    result: "State",
    text: "fn prepare(at: Point) -> State",
};
const EVALUATE: Signature = Signature {
    name: "evaluate",
    arguments: &["State", "vec3f", "vec3f"],
    result: "Lobe",
    text: "fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe",
};
const SAMPLE: Signature = Signature {
    name: "sample",
    arguments: &["State", "vec3f", "f32", "vec2f"],
    result: "Scattered",
    text: "fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered",
};

const CLEAR_COAT: Signature = Signature {
    name: "clear_coat",
    arguments: &["Point"],
    result: "ClearCoat",
    text: "fn clear_coat(at: Point) -> ClearCoat",
};

/// Functions by which a file is told to be a BSDF.
pub(super) const FUNCTIONS: [&str; 2] = [EVALUATE.name, SAMPLE.name];

/// A BSDF in WGSL. It is a [`Scattering`] surface like those in Rust, and every integrator supports it.
///
/// The file defines a `struct State` of what depends on the point alone, and three functions. Directions are those of
/// [`Scattering`]: unit vectors in the shading basis, away from the surface, with the normal along z.
///
/// ```
/// use raystream::program::BsdfShader;
/// use raystream::scene::{Material, ScatteringSurface, Scene};
///
/// let shader = BsdfShader::load(
///     "plaster.wgsl",
///     "override albedo: f32 = 0.8;
///      struct State { colour: vec3f }
///      fn prepare(at: Point) -> State { return State(vec3f(albedo)); }
///      fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
///          let pdf = cosine_hemisphere_pdf(wi.z);
///          return Lobe(s.colour * pdf, pdf);
///      }
///      fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
///          let wi = cosine_hemisphere(u2);
///          return scattered(wi, evaluate(s, wo, wi));
///      }",
///     [("albedo", "0.5")],
/// )?;
/// let mut scene = Scene::default();
/// scene.materials = vec![Material::matte("wall", glam::Vec3::ONE)];
/// scene.replace_surface("wall", ScatteringSurface::new(shader)).expect("there is a wall");
/// # Ok::<(), raystream::program::ShaderError>(())
/// ```
///
/// With `const transmits = true;` light also comes from below, from directions with `wi.z < 0`. A function
/// `clear_coat` puts the engine's clear coat over the BSDF. `base(at)` is the finish of the material itself, and
/// `finish_evaluate` and `finish_sample` call the native BSDF of a finish.
pub struct BsdfShader {
    text: Arc<SourceText>,
    hash: u64,
    loaded: Arc<Loaded>,
    evaluate: Prepared,
    sample: Prepared,
    coat: Option<Prepared>,
    transmits: bool,
    /// True if it asks for the finish of its material.
    asks_base: bool,
    /// The vertex attributes that it reads.
    attributes: Vec<AttributeRequest>,
}

/// A function that takes the state of a point, lowered together with `prepare`, which computes that state: what does
/// not depend on the point is folded, and no state is copied.
struct Prepared {
    kernel: Kernel,
    /// The point.
    inputs: PointInputs,
    /// The numbers that the function takes beside the state, and their registers.
    arguments: Vec<(usize, Register)>,
}

impl Prepared {
    fn of(loaded: &Loaded, lowered: &Lowered) -> Result<Self, ShaderError> {
        let kernel = Kernel::new(lowered.code.clone(), loaded.pictures()?);
        let inputs = kernel.inputs_over_material(&loaded.attributes());
        let behind = BlockColumns::ATTRIBUTES as u32..FIRST_INPUT;
        let arguments = kernel.code.inputs.iter().filter(|(scalar, _)| behind.contains(scalar));
        let arguments = arguments.map(|&(scalar, register)| ((scalar - behind.start) as usize, register));
        Ok(Self { arguments: arguments.collect(), inputs, kernel })
    }
}

impl fmt::Debug for BsdfShader {
    // The fingerprint of a scene contains this text. The file's name does not change the picture.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BsdfShader")
            .field("hash", &format_args!("{:016x}", self.hash))
            .finish_non_exhaustive()
    }
}

impl BsdfShader {
    /// Loads a BSDF from the text of a file, whose name messages show, with values of its parameters.
    ///
    /// # Errors
    /// When the text is no valid WGSL, lacks a function, uses what shaders lack, or a parameter is unknown or has no
    /// valid value. The message shows the place, or the right signature.
    pub fn load<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ShaderError> {
        Self::of(Loaded::new(file, text, values, true)?)
    }

    pub(super) fn of(loaded: Loaded) -> Result<Self, ShaderError> {
        loaded.refuse_displacement()?;
        Self::lowered(&Arc::new(loaded), None)
    }

    /// The BSDF as it is on a material of a surface, if that is known.
    fn lowered(loaded: &Arc<Loaded>, own: Option<&OwnSurface>) -> Result<Self, ShaderError> {
        let words: Option<Vec<Option<u32>>> =
            own.map(|own| own.constants().into_iter().map(|x| x.map(f32::to_bits)).collect());
        let base = words.as_ref().map_or(Base::Unknown, |words| Base::Of(words));
        let (ior, place) = (loaded.ior(), place(loaded, own));
        let [evaluate, sample] = [&EVALUATE, &SAMPLE];
        let evaluate = loaded.chain([&PREPARE, evaluate], base, place)?;
        let sample = loaded.chain([&PREPARE, sample], base, place)?;
        let coat = match loaded.has(CLEAR_COAT.name) {
            true => Some(loaded.lower(&CLEAR_COAT, base)?),
            false => None,
        };
        let both = [&evaluate, &sample];
        let scatters_through = both.iter().any(|lowered| lowered.scatters_through);
        if scatters_through {
            ior.map_err(|fault| loaded.error(&fault))?;
        }
        let asks_base = both.into_iter().chain(&coat).any(|lowered| lowered.asks_base);
        let coat = coat.as_ref().map(|coat| Prepared::of(loaded, coat)).transpose()?;
        let (evaluate, sample) = (Prepared::of(loaded, &evaluate)?, Prepared::of(loaded, &sample)?);
        let reads = |attribute: &AttributeRequest| {
            let mut all = [&evaluate, &sample].into_iter().chain(&coat);
            all.any(|function| function.inputs.attributes.contains(attribute))
        };
        let attributes = loaded.attributes().into_iter().filter(reads).collect();
        let transmits = loaded.constant("transmits").is_some_and(|(truth, _)| truth != 0.0);
        Ok(Self {
            text: Arc::clone(&loaded.source.text),
            hash: loaded.hash(),
            transmits: transmits || scatters_through,
            asks_base,
            attributes,
            evaluate,
            sample,
            coat,
            loaded: Arc::clone(loaded),
        })
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        self.text.file()
    }

    /// The parameters, in the order of the file.
    pub fn parameters(&self) -> &[Parameter] {
        &self.loaded.parameters
    }

    /// What a device computes: `prepare`, then `evaluate` and `sample`. What they are asked follows the scalars of the
    /// point: `wo` and `wi`, then the random numbers of `sample`.
    ///
    /// # Errors
    /// When the functions together are too long.
    #[cfg(feature = "gpu")]
    pub(super) fn program(&self) -> Result<Program, ShaderError> {
        let code = self.loaded.fork(&PREPARE, [&EVALUATE, &SAMPLE], place(&self.loaded, None))?;
        Ok(Program { text: Arc::clone(&self.text), code: Arc::new(code) })
    }

    /// True if the engine's clear coat lies over the BSDF.
    pub fn is_coated(&self) -> bool {
        self.coat.is_some()
    }

    /// True if it asks for the finish of its material.
    #[cfg(feature = "gpu")]
    pub(super) fn asks_base(&self) -> bool {
        self.asks_base
    }

    /// Number of operations of `evaluate` and of `sample`, each with `prepare`; loops counted once.
    pub fn operations(&self) -> [usize; 2] {
        [&self.evaluate, &self.sample].map(|function| function.kernel.code.instructions.len())
    }

    /// Runs a function whose arguments are the state of points and numbers.
    #[inline(always)]
    fn call<L: Lanes, const N: usize>(
        &self,
        at: &Points<'_, L>,
        function: &Prepared,
        arguments: [Num<L>; 6],
    ) -> [Num<L>; N] {
        at.lanes().outlined(Call { shader: self, at, function, arguments })
    }
}

/// [`BsdfShader::call`] out of line: under a coat there are seven calls, and each looks at all fields of points.
struct Call<'a, 's, L: Lanes, const N: usize> {
    shader: &'a BsdfShader,
    at: &'a Points<'s, L>,
    function: &'a Prepared,
    arguments: [Num<L>; 6],
}

impl<L: Lanes, const N: usize> OutlinedTask<L> for Call<'_, '_, L, N> {
    type Output = [Num<L>; N];

    #[inline(always)]
    fn run(self, l: L) -> [Num<L>; N] {
        let Self { shader, at, function, arguments } = self;
        let Prepared { kernel, inputs, arguments: registers_of } = function;
        let columns = kernel.columns(CHUNK);
        if !inputs.wanted().is_empty() {
            at.write_to(inputs.wanted(), &mut inputs.sink(&columns, L::LANES));
        }
        for &(argument, register) in registers_of {
            columns.set_chunk(register, arguments[argument]);
        }
        kernel.run_vector(l, &shader.text, &columns);
        let mut results = [Num::zero(l); N];
        for_pairs_mut(&mut results, &kernel.code.outputs, |result, &register| {
            *result = columns.int(l, register, 0).to_num_bits();
        });
        kernel.keep(columns);
        results
    }
}

impl BsdfShader {
    /// `evaluate` of the file.
    #[inline(always)]
    fn evaluate_bare<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let arguments = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z];
        let [r, g, b, pdf] = self.call(at, &self.evaluate, arguments);
        (Vector::new(r, g, b), pdf)
    }

    /// `sample` of the file.
    #[inline(always)]
    fn sample_bare<L: Lanes>(
        &self,
        at: &Points<L>,
        wo: Vector<L>,
        u: Num<L>,
        [x, y]: [Num<L>; 2],
    ) -> Scattered<L> {
        let arguments = [wo.x, wo.y, wo.z, u, x, y];
        let [x, y, z, r, g, b, pdf] = self.call(at, &self.sample, arguments);
        Scattered { wi: Vector::new(x, y, z), weight: Vector::new(r, g, b), pdf }
    }

    /// The clear coat of points seen from `wo`.
    #[inline(always)]
    fn clear_coat<L: Lanes>(&self, at: &Points<L>, coat: &Prepared, wo: Vector<L>) -> ClearCoat<L> {
        let [weight, roughness, r, g, b] = self.call(at, coat, [Num::zero(at.lanes()); 6]);
        ClearCoat::new(weight, roughness, Vector::new(r, g, b), wo)
    }

    /// `evaluate` below the horizon is 0 unless the BSDF transmits.
    #[inline(always)]
    fn evaluate_below_coat<L: Lanes>(
        &self,
        at: &Points<L>,
        wo: Vector<L>,
        wi: Vector<L>,
    ) -> (Vector<L>, Num<L>) {
        let (value, pdf) = self.evaluate_bare(at, wo, wi);
        if self.transmits {
            return (value, pdf);
        }
        let above = wi.z.above(0.0);
        (value.only(above), pdf.only(above))
    }
}

impl Scattering for BsdfShader {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        match &self.coat {
            None => self.evaluate_bare(at, wo, wi),
            Some(coat) => {
                let coat = self.clear_coat(at, coat, wo);
                coat.evaluate(wi, self.evaluate_below_coat(at, wo, wi))
            }
        }
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let Some(coat) = &self.coat else { return self.sample_bare(at, wo, u, u2) };
        let coat = self.clear_coat(at, coat, wo);
        let (chosen, rest) = coat.choose(u);
        let below = self.sample_bare(at, wo, rest, u2);
        let wi = coat.ways(chosen, u2, &below);
        let mut value = (below.weight, below.pdf);
        if chosen.any() {
            value = self.evaluate_below_coat(at, wo, wi);
        }
        coat.sample(chosen, wi, &below, value)
    }

    fn starts_from_material(&self) -> bool {
        self.asks_base
    }

    fn over(&self, own: &OwnSurface) -> Result<Option<ScatteringSurface>, String> {
        let over = Self::lowered(&self.loaded, Some(own)).map_err(|error| error.to_string())?;
        Ok(Some(ScatteringSurface::new(over)))
    }

    fn transmits(&self) -> bool {
        self.transmits
    }

    fn textures(&self) -> &[BoundTexture] {
        self.evaluate.kernel.pictures()
    }

    fn attributes(&self) -> &[AttributeRequest] {
        &self.attributes
    }

    fn reads_moment(&self) -> bool {
        let mut all = [&self.evaluate, &self.sample].into_iter().chain(&self.coat);
        all.any(|function| function.inputs.read_moment())
    }
}

/// What calls of native BSDFs need to know about the surface of a file: on a material of a surface, if that is known.
fn place(loaded: &Loaded, own: Option<&OwnSurface>) -> FinishPlace {
    let given = loaded.ior().ok().flatten().map(|ior| Transmission::Body { ior });
    let transmission = given.or_else(|| own.and_then(OwnSurface::transmission));
    FinishPlace {
        transmission: transmission.unwrap_or(Transmission::ThinWall),
        has_anisotropy: own.is_some_and(|own| own.surface().anisotropy.is_some()),
    }
}
