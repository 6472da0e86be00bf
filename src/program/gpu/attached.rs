//! Surfaces that a device computes before their hits are shaded.

use super::GpuProgram;
use crate::program::device::{Given, ShadingDevice, ShadingReport, fields, words};
use crate::program::{BsdfShader, PatternShader};
use crate::scene::{BlockColumns, DeviceCost, DeviceSurface};
use crate::trace::gpu::Gpu;
use std::any::Any;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

/// A compiled shader, and the blocks of its hits that have been shaded.
#[derive(Debug)]
struct Attached {
    program: GpuProgram,
    is_bsdf: bool,
    wanted: u64,
    /// The scalars that the device computes, then those that are inputs.
    varying: Vec<u32>,
    eligible: AtomicU64,
    shaded: AtomicU64,
}

/// Compiles a surface for a device if it is a pattern or a BSDF in WGSL of at least this many operations; its hits may
/// be computed there from now on. `None` for other surfaces, and for those that have a device.
///
/// # Errors
/// Why the shader stays on the host. The message names its file.
pub fn attach(gpu: &Arc<Gpu>, surface: &dyn Any, least: usize) -> Option<Result<(), String>> {
    let (device, is_bsdf) = device(surface)?;
    if device.get().is_some() {
        return None;
    }
    let (file, program) = if let Some(pattern) = surface.downcast_ref::<PatternShader>() {
        (pattern.file(), Ok(pattern.program()))
    } else {
        let bsdf = surface.downcast_ref::<BsdfShader>()?;
        (bsdf.file(), bsdf.program().map_err(|error| error.to_string()))
    };
    if program.as_ref().is_ok_and(|program| program.code.instructions.len() < least) {
        return None;
    }
    let made = program.and_then(|program| GpuProgram::of(gpu, program).map_err(|error| error.to_string()));
    let made = made.map(|program| {
        // Another thread may have been faster.
        let _ = device.set(Box::new(Attached::new(program, is_bsdf)));
    });
    Some(made.map_err(|error| format!("{file} is shaded on the CPU: {error}")))
}

/// What a device has shaded of a surface; `None` without a device.
pub fn shading_report(surface: &dyn Any) -> Option<ShadingReport> {
    Some(device(surface)?.0.get()?.report())
}

/// Where a surface keeps its device, and whether it is a BSDF.
fn device(surface: &dyn Any) -> Option<(&OnceLock<Box<dyn ShadingDevice>>, bool)> {
    if let Some(pattern) = surface.downcast_ref::<PatternShader>() {
        return Some((pattern.device(), false));
    }
    Some((surface.downcast_ref::<BsdfShader>()?.device(), true))
}

impl Attached {
    fn new(program: GpuProgram, is_bsdf: bool) -> Self {
        let own = |&(scalar, given): &(u32, Given)| matches!(given, Given::Input(_)).then_some(scalar);
        let own = program.kernel.given.iter().filter_map(own);
        let varying = program.outputs().iter().copied().chain(own).collect();
        let read = program.kernel.given.iter().filter_map(|&(_, given)| match given {
            Given::Input(input) => Some(input),
            Given::Word(_) => None,
        });
        let wanted = fields(program.inputs().iter().copied().chain(read));
        Self { program, is_bsdf, wanted, varying, eligible: AtomicU64::new(0), shaded: AtomicU64::new(0) }
    }
}

impl DeviceSurface for Attached {
    fn wanted(&self) -> u64 {
        self.wanted
    }

    fn varying(&self) -> &[u32] {
        &self.varying
    }

    fn is_sound(&self) -> bool {
        self.program.refused().is_none()
    }

    fn compute(
        &self,
        points: usize,
        from: &BlockColumns,
        to: &mut BlockColumns,
    ) -> Result<DeviceCost, String> {
        let inputs = words(self.program.inputs(), points, from);
        let computed = self.program.compute(points, &inputs);
        let (results, cost) = computed.map_err(|error| format!("{}: {error}", self.program.file()))?;
        for (column, &scalar) in results.chunks(points).zip(self.program.outputs()) {
            let to = to.column_mut(scalar as usize);
            to.iter_mut().zip(column).for_each(|(number, &word)| *number = f32::from_bits(word));
        }
        for &(scalar, given) in &self.program.kernel.given {
            if let Given::Input(input) = given {
                to.column_mut(scalar as usize)[..points]
                    .copy_from_slice(&from.column(input as usize)[..points]);
            }
        }
        Ok(cost)
    }

    fn fill_others(&self, points: usize, to: &mut BlockColumns) {
        for &(scalar, given) in &self.program.kernel.given {
            if let Given::Word(word) = given {
                to.column_mut(scalar as usize)[..points].fill(f32::from_bits(word));
            }
        }
    }

    fn count(&self, from_device: bool) {
        self.eligible.fetch_add(1, Relaxed);
        self.shaded.fetch_add(u64::from(from_device), Relaxed);
    }
}

impl ShadingDevice for Attached {
    fn report(&self) -> ShadingReport {
        let report = self.program.report();
        ShadingReport {
            is_bsdf: self.is_bsdf,
            eligible: self.eligible.load(Relaxed),
            shaded: self.shaded.load(Relaxed),
            points: report.points,
            undecided: report.undecided,
            checked: report.checked,
            refused: self.program.refused().map(ToString::to_string),
        }
    }
}
