//! Hits → radiance: surface interaction, BSDFs, lights.
