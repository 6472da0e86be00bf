//! Surfaces that a device computes before their hits are shaded.

use super::GpuPattern;
use crate::program::PatternShader;
use crate::program::device::{Given, ShadingDevice, ShadingReport, words};
use crate::scene::{BlockColumns, BlockSurface, DeviceCost, DeviceSurface};
use crate::trace::gpu::Gpu;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A compiled pattern, and the blocks of its hits that have been shaded.
#[derive(Debug)]
struct Attached {
    pattern: GpuPattern,
    /// The scalars that the device computes, then those that are the point's own.
    varying: Vec<u32>,
    eligible: AtomicU64,
    shaded: AtomicU64,
}

/// Compiles a surface for a device if it is a pattern in WGSL of at least this many operations; its hits may be
/// computed there from now on. `None` for other surfaces, and for those that have a device.
///
/// # Errors
/// Why the pattern stays on the host. The message names its file.
pub fn attach(gpu: &Arc<Gpu>, surface: &dyn BlockSurface, least: usize) -> Option<Result<(), String>> {
    let shader = surface.as_any().downcast_ref::<PatternShader>()?;
    if shader.operations() < least || shader.shading_report().is_some() {
        return None;
    }
    let made = GpuPattern::new(gpu, shader).map(|pattern| shader.attach(Box::new(Attached::new(pattern))));
    Some(made.map_err(|error| format!("{} is shaded on the CPU: {error}", shader.file())))
}

/// What a device has shaded of a surface; `None` without a device.
pub fn shading_report(surface: &dyn BlockSurface) -> Option<ShadingReport> {
    surface.as_any().downcast_ref::<PatternShader>()?.shading_report()
}

impl Attached {
    fn new(pattern: GpuPattern) -> Self {
        let own = |&(scalar, given): &(u32, Given)| matches!(given, Given::Input(_)).then_some(scalar);
        let own = pattern.kernel.given.iter().filter_map(own);
        let varying = pattern.outputs().iter().copied().chain(own).collect();
        Self { pattern, varying, eligible: AtomicU64::new(0), shaded: AtomicU64::new(0) }
    }
}

impl DeviceSurface for Attached {
    fn varying(&self) -> &[u32] {
        &self.varying
    }

    fn is_sound(&self) -> bool {
        self.pattern.refused().is_none()
    }

    fn compute(
        &self,
        points: usize,
        from: &BlockColumns,
        to: &mut BlockColumns,
    ) -> Result<DeviceCost, String> {
        let inputs = words(self.pattern.inputs(), points, from);
        let computed = self.pattern.compute(points, &inputs);
        let (results, cost) = computed.map_err(|error| format!("{}: {error}", self.pattern.program.file))?;
        for (column, &scalar) in results.chunks(points).zip(self.pattern.outputs()) {
            let to = to.column_mut(scalar as usize);
            to.iter_mut().zip(column).for_each(|(number, &word)| *number = f32::from_bits(word));
        }
        for &(scalar, given) in &self.pattern.kernel.given {
            if let Given::Input(input) = given {
                to.column_mut(scalar as usize)[..points]
                    .copy_from_slice(&from.column(input as usize)[..points]);
            }
        }
        Ok(cost)
    }

    fn fill_others(&self, points: usize, to: &mut BlockColumns) {
        for &(scalar, given) in &self.pattern.kernel.given {
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
