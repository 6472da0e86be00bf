//! The command line of raystream.

fn main() -> std::process::ExitCode {
    raystream::cli::run()
}
