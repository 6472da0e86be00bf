//! Pipelines that a device has compiled. A driver takes up to half a second for one, and scenes of one shape have the
//! same.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use xxhash_rust::xxh3::Xxh3;

/// Pipelines by their sources and entry points, from which their layouts follow. There are as many as shapes of scenes:
/// a few dozen at most.
#[derive(Debug, Default)]
pub(crate) struct KernelCache(Mutex<HashMap<u128, wgpu::ComputePipeline>>);

impl KernelCache {
    /// The pipeline of an entry point, compiled if it is not there. Two threads may compile the same one.
    ///
    /// # Errors
    /// Those of `compile`, which are not kept.
    pub fn pipeline(
        &self,
        source: &str,
        entry: &str,
        compile: impl FnOnce() -> Result<wgpu::ComputePipeline, String>,
    ) -> Result<wgpu::ComputePipeline, String> {
        let mut hasher = Xxh3::new();
        // No source contains a zero.
        [entry, "\0", source].iter().for_each(|part| hasher.update(part.as_bytes()));
        let key = hasher.digest128();
        let found = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        if let Some(pipeline) = found {
            return Ok(pipeline);
        }
        let pipeline = compile()?;
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(key, pipeline.clone());
        Ok(pipeline)
    }

    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}
