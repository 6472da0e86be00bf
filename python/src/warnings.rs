//! What the engine warns of, told to Python's logger `raystream`.

use log::{Level, LevelFilter, Log, Metadata, Record};
use pyo3::prelude::*;

struct PythonLogger;

impl Log for PythonLogger {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= Level::Warn && metadata.target().starts_with("raystream")
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        // No warning is worth an error, nor a wait for an interpreter that ends.
        Python::try_attach(|py| -> PyResult<()> {
            let logger = py.import("logging")?.call_method1("getLogger", ("raystream",))?;
            let call = if record.level() == Level::Error { "error" } else { "warning" };
            logger.call_method1(call, ("%s", record.args().to_string())).map(drop)
        });
    }

    fn flush(&self) {}
}

/// Sends warnings to Python from now on.
pub fn forward() {
    // Another logger can only be there if the module is imported twice.
    if log::set_logger(&PythonLogger).is_ok() {
        log::set_max_level(LevelFilter::Warn);
    }
}
