//! The times that POV-Ray tells after a picture.

use super::PovRayError;

/// Seconds of the parts of a run, by POV-Ray's own clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// Reading the scene, and building the tree of each mesh.
    pub parse_s: f64,
    /// Building the tree of the objects.
    pub bounding_s: f64,
    /// Rendering.
    pub trace_s: f64,
}

/// Reads the times from what POV-Ray writes.
///
/// # Errors
/// When a time is missing.
pub fn read_times(said: &str) -> Result<Times, PovRayError> {
    let seconds = |name: &'static str| {
        // `Trace Time:  0 hours  0 minutes  1 seconds (1.234 seconds)`
        let line = said.lines().find(|line| line.trim_start().starts_with(name));
        let told = line.and_then(|line| line.split_once('(')?.1.split_once(" seconds"));
        told.and_then(|(number, _)| number.parse().ok()).ok_or(PovRayError::Statistics(name))
    };
    Ok(Times {
        parse_s: seconds("Parse Time")?,
        bounding_s: seconds("Bounding Time")?,
        trace_s: seconds("Trace Time")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID: &str = "\
Parser Time
  Parse Time:       0 hours  1 minutes  2 seconds (62.125 seconds)
              using 1 thread(s) with 61.000 CPU-seconds total
  Bounding Time:    0 hours  0 minutes  0 seconds (0.001 seconds)
              using 1 thread(s) with 0.000 CPU-seconds total
Render Time:
  Photon Time:      No photons
  Trace Time:       0 hours  0 minutes  1 seconds (1.250 seconds)
              using 2 thread(s) with 2.400 CPU-seconds total
";

    #[test]
    fn times_are_those_in_parentheses_and_a_missing_one_is_named() {
        let times = Times { parse_s: 62.125, bounding_s: 0.001, trace_s: 1.25 };
        assert_eq!(read_times(SAID).expect("all three"), times);
        let without = read_times(&SAID.replace("Trace Time", "Time")).expect_err("one lacks");
        assert_eq!(without.to_string(), "POV-Ray's statistics have no Trace Time");
    }
}
