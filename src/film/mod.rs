//! Accumulation, tone mapping and image files.
