//! Traces of jobs for OpenTelemetry, behind the feature `otel`. Without it they are nothing, and cost nothing.

#[cfg(not(feature = "otel"))]
mod off;
#[cfg(feature = "otel")]
mod otlp;

#[cfg(not(feature = "otel"))]
pub use off::{Traces, parent};
#[cfg(feature = "otel")]
pub use otlp::{Traces, parent};
