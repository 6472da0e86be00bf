//! What a device computes for a stream's hits before host threads shade them.

use super::Frame;
use crate::shade::stage::{HitSource, StageStream};
use crate::stream::{DeviceError, DeviceReport, Hit};

impl Frame {
    /// [`crate::schedule::Renderer::stage`] for shaders that take finishes from a device.
    pub(super) fn stage(
        &self,
        hits: &[Hit],
        source: &impl HitSource,
        words: &mut [u32],
    ) -> Result<DeviceReport, DeviceError> {
        let cost = self.simd().run(StageStream { scene: self.scene(), hits, source, words });
        let cost = cost.map_err(DeviceError::Failed)?;
        Ok(DeviceReport {
            bytes_copied: cost.bytes,
            checked: cost.checked,
            waiting_ns: cost.waiting_ns,
            ..DeviceReport::default()
        })
    }
}
