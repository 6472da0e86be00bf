//! The one writer of standard output and standard error. Neither can end the work: a reader that has gone is no
//! failure, and any other failure is reported once, when the command has written its files.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// The first failure of standard output. After it nothing more is printed there.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Prints a line to standard output, with the arguments of [`format!`].
macro_rules! stdout_line {
    ($($argument:tt)*) => { $crate::printing::print(format_args!($($argument)*)) };
}

/// Prints a line to standard error, with the arguments of [`format!`].
macro_rules! stderr_line {
    ($($argument:tt)*) => { $crate::printing::tell(format_args!($($argument)*)) };
}

/// Prints a line to standard output.
pub fn print(line: Arguments<'_>) {
    if FAILURE.get().is_none()
        && let Err(error) = writeln!(io::stdout().lock(), "{line}")
    {
        // Another thread's failure may have come first; it tells as much.
        let _ = FAILURE.set(error);
    }
}

/// Prints a line to standard error. There is nowhere to report that it cannot be printed.
pub fn tell(line: Arguments<'_>) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// True if standard output has lost its reader, so that what only prints can end.
pub fn is_unread() -> bool {
    FAILURE.get().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// Completes standard output.
///
/// # Errors
/// Why something could not be printed, unless its reader has gone.
pub fn finish() -> Result<(), String> {
    let failure = match (FAILURE.get(), io::stdout().lock().flush()) {
        (Some(error), _) => (error.kind(), error.to_string()),
        (None, Err(error)) => (error.kind(), error.to_string()),
        (None, Ok(())) => return Ok(()),
    };
    match failure {
        (ErrorKind::BrokenPipe, _) => Ok(()),
        (_, reason) => Err(format!("standard output cannot be written: {reason}")),
    }
}
