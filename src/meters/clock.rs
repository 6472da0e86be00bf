//! Clock frequencies of processor cores, as Linux reports them.

use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// The source of the clock frequencies.
#[derive(Debug)]
pub struct Clock(Source);

#[derive(Debug)]
enum Source {
    /// One file for each core, in kHz.
    Cpufreq(Vec<PathBuf>),
    /// One file about all cores.
    Cpuinfo(PathBuf),
}

impl Clock {
    /// The source on this machine. `None` if the system reports no clock frequencies.
    pub fn find() -> Option<Self> {
        Self::find_in(Path::new("/sys/devices/system/cpu"), Path::new("/proc/cpuinfo"))
    }

    fn find_in(cores: &Path, cpuinfo: &Path) -> Option<Self> {
        let cores = std::fs::read_dir(cores).into_iter().flatten().flatten();
        let files = cores.map(|core| core.path().join("cpufreq/scaling_cur_freq"));
        let files: Vec<PathBuf> = files.filter(|file| file.exists()).collect();
        let source =
            if files.is_empty() { Source::Cpuinfo(cpuinfo.to_owned()) } else { Source::Cpufreq(files) };
        Some(Self(source)).filter(|clock| clock.mhz().is_some())
    }

    /// The mean clock frequency of all cores, in MHz.
    pub fn mhz(&self) -> Option<f64> {
        match &self.0 {
            Source::Cpufreq(files) => {
                mean(files.iter().map(|file| Some(1e-3 * number(&read_to_string(file).ok()?)?)))
            }
            Source::Cpuinfo(file) => {
                let text = read_to_string(file).ok()?;
                mean(
                    text.lines()
                        .filter(|line| line.starts_with("cpu MHz"))
                        .map(|line| number(line.split_once(':')?.1)),
                )
            }
        }
    }
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok()
}

/// The mean of the numbers that could be read. `None` if there are none.
fn mean(numbers: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let (sum, count) = numbers.flatten().fold((0.0, 0.0), |(sum, count), number| (sum + number, count + 1.0));
    (count > 0.0).then_some(sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_read_from_either_source() {
        let folder = tempfile::tempdir().expect("a folder");
        let (cores, cpuinfo) = (folder.path().join("cpu"), folder.path().join("cpuinfo"));
        assert!(Clock::find_in(&cores, &cpuinfo).is_none());
        std::fs::write(
            &cpuinfo,
            "processor\t: 0\ncpu MHz\t\t: 2000.5\nprocessor\t: 1\ncpu MHz\t\t: 3000.5\n",
        )
        .unwrap();
        assert_eq!(Clock::find_in(&cores, &cpuinfo).and_then(|clock| clock.mhz()), Some(2500.5));
        for (core, khz) in [("cpu0", "2400000\n"), ("cpu1", "2600000\n")] {
            let core = cores.join(core).join("cpufreq");
            std::fs::create_dir_all(&core).unwrap();
            std::fs::write(core.join("scaling_cur_freq"), khz).unwrap();
        }
        assert_eq!(Clock::find_in(&cores, &cpuinfo).and_then(|clock| clock.mhz()), Some(2500.0));
    }
}
