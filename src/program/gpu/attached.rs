//! Surfaces whose blocks of hits a device computes.

use super::{GpuPattern, GpuPatternError};
use crate::program::PatternShader;
use crate::program::device::{Given, PatternDevice, ShadingReport, words};
use crate::scene::{BlockColumns, BlockSurface};
use crate::trace::gpu::Gpu;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A compiled pattern and its blocks.
#[derive(Debug)]
struct Attached {
    pattern: GpuPattern,
    eligible: AtomicU64,
    shaded: AtomicU64,
}

/// Compiles a surface for a device if it is a pattern in WGSL of at least this many operations; its hits are computed
/// there from now on. `None` for other surfaces, and for those that have a device.
///
/// # Errors
/// Why the pattern stays on the host. The message names its file.
pub fn attach(gpu: &Arc<Gpu>, surface: &dyn BlockSurface, least: usize) -> Option<Result<(), String>> {
    let shader = surface.as_any().downcast_ref::<PatternShader>()?;
    if shader.operations() < least || shader.shading_report().is_some() {
        return None;
    }
    let attached = |pattern| Attached { pattern, eligible: AtomicU64::new(0), shaded: AtomicU64::new(0) };
    let made = GpuPattern::new(gpu, shader).map(|pattern| shader.attach(Box::new(attached(pattern))));
    Some(made.map_err(|error| format!("{} is shaded on the CPU: {error}", shader.file())))
}

/// What a device has shaded of a surface; `None` without a device.
pub fn shading_report(surface: &dyn BlockSurface) -> Option<ShadingReport> {
    surface.as_any().downcast_ref::<PatternShader>()?.shading_report()
}

impl PatternDevice for Attached {
    fn compute(
        &self,
        shader: &PatternShader,
        points: usize,
        from: &BlockColumns,
        to: &mut BlockColumns,
    ) -> Result<bool, u32> {
        self.eligible.fetch_add(1, Relaxed);
        let inputs = words(self.pattern.inputs(), points, from);
        let results = match self.pattern.evaluate(shader, points, &inputs) {
            Ok(results) => results,
            Err(GpuPatternError::Endless { line }) => return Err(line),
            Err(_) => return Ok(false),
        };
        for &(scalar, given) in &self.pattern.kernel.given {
            let to = &mut to.column_mut(scalar as usize)[..points];
            match given {
                Given::Word(word) => to.fill(f32::from_bits(word)),
                Given::Input(input) => to.copy_from_slice(&from.column(input as usize)[..points]),
            }
        }
        for (column, &scalar) in results.chunks(points).zip(self.pattern.outputs()) {
            let to = to.column_mut(scalar as usize);
            to.iter_mut().zip(column).for_each(|(number, &word)| *number = f32::from_bits(word));
        }
        self.shaded.fetch_add(1, Relaxed);
        Ok(true)
    }

    fn report(&self) -> ShadingReport {
        let report = self.pattern.report();
        ShadingReport {
            eligible: self.eligible.load(Relaxed),
            shaded: self.shaded.load(Relaxed),
            points: report.points,
            undecided: report.undecided,
            checked: report.checked,
            refused: self.pattern.refused().map(ToString::to_string),
        }
    }
}
