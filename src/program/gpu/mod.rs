//! Patterns and BSDFs on a GPU, with the bits of the host's.
//!
//! The device is not trusted with a shader's kernel (`program::device`): each operation of the kernel is compared with
//! the host's in 10⁵ cases, and the whole shader at 10⁴ points. A device that flushes subnormal numbers gets a kernel
//! that tells which points come near them; the host computes those, and points with infinities or NaN. Any difference
//! refuses the shader. No renderer uses these kernels yet: they are for paths that stay on the device.

mod check;
mod dispatch;
#[cfg(test)]
mod tests;

use super::device::{Kernel, Program};
use super::{BsdfShader, PatternShader, ShaderError};
use crate::device::{Checks, FloatControls, Fma, Gpu, float_controls, spirv};
use dispatch::{Entry, MOST_POINTS, Pipelines};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Reason why a device cannot compute a shader.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuProgramError {
    /// Arithmetic can be fixed with Vulkan alone.
    #[error(
        "{adapter} is used through {backend}, which cannot forbid that arithmetic is reordered; Vulkan can"
    )]
    NoVulkan {
        /// The adapter.
        adapter: String,
        /// Its graphics interface.
        backend: String,
    },
    /// The kernel cannot be made, or the driver refuses it.
    #[error("no kernel: {0}")]
    Kernel(String),
    /// The shader asks for the finish of its material, whose textures devices do not have.
    #[error("devices do not compute `base`, the finish of a material with its textures")]
    Base,
    /// The shader calls the native BSDF of a finish, or lies under the native clear coat.
    #[error("devices do not compute native BSDFs and clear coats")]
    NativeBsdf,
    /// The shader looks up pictures, which devices do not have.
    #[error("devices do not look up pictures")]
    Pictures,
    /// An operation has other bits.
    #[error(
        "the device computes \"{operation}\" of {:#x}, {:#x}, {:#x} as {word:#x}, the host as {expected:#x}",
        operands[0], operands[1], operands[2]
    )]
    Operation {
        /// The operation.
        operation: String,
        /// Words of its operands.
        operands: [u32; 3],
        /// The device's result.
        word: u32,
        /// The host's result.
        expected: u32,
    },
    /// The device decides too few cases of an operation to be of use.
    #[error("the device leaves \"{operation}\" to the host in nearly all cases")]
    Undecided {
        /// The operation.
        operation: String,
    },
    /// Each operation has the host's bits, the shader has not.
    #[error("{wrong} of {checked} points differ, though each operation alone has the host's bits")]
    Points {
        /// Points that differ.
        wrong: usize,
        /// Points compared.
        checked: usize,
    },
    /// The device was lost.
    #[error("the device was lost: {0}")]
    Lost(String),
    /// The device has no memory for the points.
    #[error("no memory for its points: {0}")]
    Memory(String),
    /// A loop of the shader does not end.
    #[error("{0}")]
    Endless(ShaderError),
}

/// Account of the points of a shader that a device has computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GpuProgramReport {
    /// Points.
    pub points: u64,
    /// Points among them that the host computed, because the device could not decide.
    pub undecided: u64,
}

/// A pattern or a BSDF compiled for a GPU and compared with the host.
#[derive(Debug)]
pub struct GpuProgram {
    gpu: Arc<Gpu>,
    program: Program,
    kernel: Kernel,
    pipelines: Pipelines,
    /// True if points near subnormal numbers are left to the host.
    flushes: bool,
    points: AtomicU64,
    undecided: AtomicU64,
}

impl GpuProgram {
    /// Compiles a pattern and compares it with the host.
    ///
    /// # Errors
    /// When the device cannot compute the pattern, or not with the host's bits.
    pub fn of_pattern(gpu: &Arc<Gpu>, shader: &PatternShader) -> Result<Self, GpuProgramError> {
        if shader.asks_base() {
            return Err(GpuProgramError::Base);
        }
        Self::of(gpu, shader.program())
    }

    /// Compiles what a BSDF answers, and compares it with the host. What it is asked follows the scalars of the point:
    /// `wo` and `wi`, then the three random numbers of `sample`. Its results are those of `evaluate`, then of `sample`.
    ///
    /// # Errors
    /// When the device cannot compute the BSDF, or not with the host's bits.
    pub fn of_bsdf(gpu: &Arc<Gpu>, shader: &BsdfShader) -> Result<Self, GpuProgramError> {
        if shader.asks_base() {
            return Err(GpuProgramError::Base);
        }
        if shader.is_coated() {
            return Err(GpuProgramError::NativeBsdf);
        }
        let program = shader.program().map_err(|error| GpuProgramError::Kernel(error.to_string()))?;
        Self::of(gpu, program)
    }

    fn of(gpu: &Arc<Gpu>, program: Program) -> Result<Self, GpuProgramError> {
        if program.code.reads_pictures() {
            return Err(GpuProgramError::Pictures);
        }
        if program.code.calls_finishes() {
            return Err(GpuProgramError::NativeBsdf);
        }
        let make = |flushes: bool| {
            let kernel = Kernel::new(&program, flushes).map_err(GpuProgramError::Kernel)?;
            Self::of_kernel(gpu, program.clone(), kernel, flushes)
        };
        match make(false) {
            Err(GpuProgramError::Operation { .. } | GpuProgramError::Points { .. }) => make(true),
            made => made,
        }
    }

    fn of_kernel(
        gpu: &Arc<Gpu>,
        program: Program,
        kernel: Kernel,
        flushes: bool,
    ) -> Result<Self, GpuProgramError> {
        let info = gpu.info();
        let controls = gpu.guard(|device, _| Ok(float_controls(device)));
        let no_vulkan =
            || GpuProgramError::NoVulkan { adapter: info.name.clone(), backend: info.backend.clone() };
        let controls: FloatControls = controls.map_err(GpuProgramError::Lost)?.ok_or_else(no_vulkan)?;
        let words = spirv(&kernel.source, None, controls, Fma::Refused, Checks::Kept)
            .map_err(GpuProgramError::Kernel)?;
        let pipelines = gpu.attempt(|device, _| Pipelines::new(device, &words));
        let pipelines = pipelines.map_err(GpuProgramError::Lost)?.map_err(GpuProgramError::Kernel)?;
        check::operations(gpu, &pipelines, &kernel)?;
        check::points(gpu, &pipelines, &kernel, &program)?;
        Ok(Self {
            gpu: gpu.clone(),
            program,
            kernel,
            pipelines,
            flushes,
            points: AtomicU64::new(0),
            undecided: AtomicU64::new(0),
        })
    }

    /// True if points near subnormal numbers are left to the host, because the device flushes those.
    pub fn flushes(&self) -> bool {
        self.flushes
    }

    /// The scalars of points, and of what is asked there, that the shader reads, in the order of the columns.
    pub fn inputs(&self) -> &[u32] {
        &self.kernel.inputs
    }

    /// The scalars of results that the shader computes, in the order of the columns. The others are as given.
    pub fn outputs(&self) -> &[u32] {
        &self.kernel.outputs
    }

    /// Name of the shader's file.
    pub fn file(&self) -> &str {
        self.program.text.file()
    }

    /// The account of the points computed so far.
    pub fn report(&self) -> GpuProgramReport {
        GpuProgramReport { points: self.points.load(Relaxed), undecided: self.undecided.load(Relaxed) }
    }

    /// Computes columns of results from columns of inputs, `points` words each.
    ///
    /// # Errors
    /// When the device is lost or has no memory for the points, or when a loop of the shader does not end.
    ///
    /// # Panics
    /// Unless there is a word for each point and input.
    pub fn evaluate(&self, points: usize, inputs: &[u32]) -> Result<Vec<u32>, GpuProgramError> {
        assert_eq!(inputs.len(), points * self.kernel.inputs.len(), "a word for each point and input");
        let mut all = vec![0; points * self.kernel.outputs.len()];
        for start in (0..points).step_by(MOST_POINTS) {
            let end = points.min(start + MOST_POINTS);
            let piece: Vec<u32> =
                inputs.chunks(points).flat_map(|column| &column[start..end]).copied().collect();
            let results = self.piece(end - start, &piece)?;
            for (to, from) in all.chunks_mut(points).zip(results.chunks(end - start)) {
                to[start..end].copy_from_slice(from);
            }
        }
        Ok(all)
    }

    /// Computes the points of one dispatch.
    fn piece(&self, points: usize, inputs: &[u32]) -> Result<Vec<u32>, GpuProgramError> {
        let outputs = self.kernel.outputs.len() * points;
        let mut results = vec![0; outputs + points];
        self.pipelines.run(&self.gpu, (Entry::Shade, points), inputs, &mut results)?;
        let undecided: Vec<usize> = (0..points).filter(|&point| results[outputs + point] != 0).collect();
        let decided = self.on_host(points, inputs, &undecided)?;
        results.truncate(outputs);
        for (to, from) in results.chunks_mut(points).zip(decided.chunks(undecided.len().max(1))) {
            undecided.iter().zip(from).for_each(|(&point, &word)| to[point] = word);
        }
        self.points.fetch_add(points as u64, Relaxed);
        self.undecided.fetch_add(undecided.len() as u64, Relaxed);
        Ok(results)
    }

    /// The host's results for some of the points.
    fn on_host(&self, points: usize, inputs: &[u32], some: &[usize]) -> Result<Vec<u32>, GpuProgramError> {
        if some.is_empty() {
            return Ok(Vec::new());
        }
        let picked: Vec<u32> =
            inputs.chunks(points).flat_map(|column| some.iter().map(|&point| column[point])).collect();
        let results = self.program.evaluate(&self.kernel, some.len(), &picked);
        results.map_err(GpuProgramError::Endless)
    }
}
