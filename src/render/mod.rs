//! The integrators that plug into the scheduler.
