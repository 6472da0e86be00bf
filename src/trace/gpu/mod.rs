//! The GPU tracer; the only place that names wgpu.
