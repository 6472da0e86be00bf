//! RAPL on Linux: the energy of Intel and AMD processors. Reading it may require privileges.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The folder in which Linux exposes RAPL.
const POWERCAP: &str = "/sys/class/powercap";

/// A machine's meters, with their counts when measuring started.
#[derive(Clone, Debug, Default)]
pub struct Meters(Vec<Meter>);

#[derive(Clone, Debug)]
struct Meter {
    name: String,
    counter: PathBuf,
    /// The counter wraps around to 0 at this value, in microjoules.
    range_uj: u64,
    start_uj: u64,
}

impl Meters {
    /// Reads all meters of this machine. Meters that cannot be read are left out.
    pub fn start() -> Self {
        Self::start_in(Path::new(POWERCAP))
    }

    fn start_in(folder: &Path) -> Self {
        let zones = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|zone| zone.path());
        let mut meters: Vec<Meter> = zones.filter_map(|zone| Meter::start(&zone)).collect();
        meters.sort_by(|a, b| a.name.cmp(&b.name));
        Self(meters)
    }

    /// Joules since the start, by meter. Counters wrap around after some minutes of load, so longer measurements
    /// report too little.
    pub fn joules(&self) -> BTreeMap<String, f64> {
        let joules = |meter: &Meter| {
            let now_uj = number(&meter.counter)?;
            Some((meter.name.clone(), meter.spent_uj(now_uj) as f64 * 1e-6))
        };
        self.0.iter().filter_map(joules).collect()
    }
}

/// Average power of a meter between two readings.
pub struct Power {
    meter: Meter,
    since: Instant,
}

impl Meters {
    /// The same meters for repeated readings of power.
    pub fn into_power(self) -> Vec<Power> {
        let since = Instant::now();
        self.0.into_iter().map(|meter| Power { meter, since }).collect()
    }
}

impl Power {
    /// The meter's name.
    pub fn name(&self) -> &str {
        &self.meter.name
    }

    /// Watts since the last reading. `None` if too little time has passed.
    pub fn watts(&mut self, now: Instant) -> Option<f64> {
        let seconds = now.saturating_duration_since(self.since).as_secs_f64();
        // The system updates the counter every millisecond.
        if seconds < 0.005 {
            return None;
        }
        let now_uj = number(&self.meter.counter)?;
        let spent_uj = self.meter.spent_uj(now_uj);
        (self.meter.start_uj, self.since) = (now_uj, now);
        Some(spent_uj as f64 * 1e-6 / seconds)
    }
}

impl Meter {
    /// The meter of a zone: `intel-rapl:0` is a processor, `intel-rapl:0:1` a part of it.
    fn start(zone: &Path) -> Option<Self> {
        let file = zone.file_name()?.to_str()?;
        let parts: Vec<&str> = file.strip_prefix("intel-rapl:")?.split(':').collect();
        let name = |zone: &Path| Some(std::fs::read_to_string(zone.join("name")).ok()?.trim().to_owned());
        let name = match parts[..] {
            [processor, _] => {
                let whole = name(&zone.with_file_name(format!("intel-rapl:{processor}")))?;
                format!("{whole}/{}", name(zone)?)
            }
            _ => name(zone)?,
        };
        let counter = zone.join("energy_uj");
        let (start_uj, range_uj) = (number(&counter)?, number(&zone.join("max_energy_range_uj"))?);
        Some(Self { name, counter, range_uj, start_uj })
    }

    fn spent_uj(&self, now_uj: u64) -> u64 {
        now_uj.checked_sub(self.start_uj).unwrap_or_else(|| now_uj + self.range_uj - self.start_uj)
    }
}

fn number(file: &Path) -> Option<u64> {
    std::fs::read_to_string(file).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::time::Duration;

    #[test]
    fn meters_are_read_by_name_and_wrap_around() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |zone: &str, file: &str, text: &str| {
            fs::create_dir_all(folder.path().join(zone)).expect("a zone");
            fs::write(folder.path().join(zone).join(file), text).expect("a file");
        };
        for (zone, name, energy) in [
            ("intel-rapl:0", "package-0", "1000000\n"),
            ("intel-rapl:0:1", "dram", "900000\n"),
            ("intel-rapl", "no zone", "0"),
            ("intel-rapl:1", "no counter", ""),
        ] {
            write(zone, "name", &format!("{name}\n"));
            write(zone, "energy_uj", energy);
            write(zone, "max_energy_range_uj", "1000000\n");
        }
        let meters = Meters::start_in(folder.path());
        write("intel-rapl:0", "energy_uj", "3500000\n");
        write("intel-rapl:0:1", "energy_uj", "150000\n");
        let expected = [("package-0".to_owned(), 2.5), ("package-0/dram".to_owned(), 0.25)];
        assert_eq!(meters.joules(), BTreeMap::from(expected));
        let mut power = meters.into_power();
        let later = Instant::now() + Duration::from_secs(5);
        assert_eq!(power[0].name(), "package-0");
        // 2.5 J in slightly more than five seconds, and then nothing in no time.
        let watts = power[0].watts(later).expect("time has passed");
        assert!((0.49..=0.5).contains(&watts), "{watts} W");
        assert_eq!(power[0].watts(later), None);
        assert_eq!(power[0].watts(later + Duration::from_secs(1)), Some(0.0));
        assert!(Meters::start_in(&folder.path().join("nowhere")).joules().is_empty());
    }
}
