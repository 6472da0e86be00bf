//! BSDFs in WGSL.

use super::code::Register;
#[cfg(feature = "gpu")]
use super::device::Program;
use super::kernel::{Kernel, PointInputs, Signature};
use super::loaded::Loaded;
use super::operation::CHUNK;
use super::parameter::Parameter;
use super::source::{ShaderError, SourceText};
use crate::lanes::{Lanes, Num, Vector, for_pairs_mut};
use crate::scene::{BoundTexture, Points, Scattered, Scattering};
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
/// With `const transmits = true;` light also comes from below, from directions with `wi.z < 0`.
pub struct BsdfShader {
    text: Arc<SourceText>,
    hash: u64,
    loaded: Loaded,
    evaluate: Prepared,
    sample: Prepared,
    transmits: bool,
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
    fn of(loaded: &Loaded, function: &Signature) -> Result<Self, ShaderError> {
        let kernel = loaded.chain(&PREPARE, function)?;
        let inputs = kernel.inputs();
        let scalars = inputs.registers.len();
        let arguments = kernel.code.inputs.iter().filter_map(|&(scalar, register)| {
            let argument = (scalar as usize).checked_sub(scalars)?;
            Some((argument, register))
        });
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
        let evaluate = Prepared::of(&loaded, &EVALUATE)?;
        let sample = Prepared::of(&loaded, &SAMPLE)?;
        Ok(Self {
            text: Arc::clone(&loaded.source.text),
            hash: loaded.hash(),
            transmits: loaded.constant("transmits").is_some_and(|(truth, _)| truth != 0.0),
            loaded,
            evaluate,
            sample,
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
        let code = self.loaded.fork(&PREPARE, [&EVALUATE, &SAMPLE])?;
        Ok(Program { text: Arc::clone(&self.text), code: Arc::new(code) })
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
        let Prepared { kernel, inputs, arguments: registers_of } = function;
        let l = at.lanes();
        let columns = kernel.columns(CHUNK);
        if inputs.wanted != 0 {
            at.write_to(inputs.wanted, &mut inputs.sink(&columns, L::LANES));
        }
        for &(argument, register) in registers_of {
            columns.set_chunk(register, arguments[argument]);
        }
        kernel.run_vector(l, &self.text, &columns);
        let mut results = [Num::zero(l); N];
        for_pairs_mut(&mut results, &kernel.code.outputs, |result, &register| {
            *result = columns.int(l, register, 0).to_num_bits();
        });
        kernel.keep(columns);
        results
    }
}

impl Scattering for BsdfShader {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let arguments = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z];
        let [r, g, b, pdf] = self.call(at, &self.evaluate, arguments);
        (Vector::new(r, g, b), pdf)
    }

    #[inline(always)]
    fn sample<L: Lanes>(
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

    fn transmits(&self) -> bool {
        self.transmits
    }

    fn textures(&self) -> &[BoundTexture] {
        self.evaluate.kernel.pictures()
    }

    fn reads_moment(&self) -> bool {
        self.evaluate.inputs.read_moment() || self.sample.inputs.read_moment()
    }
}
