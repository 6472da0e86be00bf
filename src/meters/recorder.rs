//! Records clock frequencies and power over time (RA, Figure 5).

use super::clock::Clock;
use super::nvml::Devices;
use super::rapl;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The shortest time between two readings.
pub const PERIOD: Duration = Duration::from_millis(20);

/// Reading takes at most 1/`SHARE` of one thread's time.
const SHARE: u32 = 200;

/// A quantity over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name of the quantity.
    pub name: String,
    /// Unit of the quantity.
    pub unit: &'static str,
    /// Time and value of each reading.
    pub points: Vec<(Instant, f64)>,
}

/// Reads clock frequencies and power on a thread of its own until it is finished.
#[derive(Debug)]
pub struct Recorder {
    stop: Sender<()>,
    thread: JoinHandle<Vec<Series>>,
}

impl Recorder {
    /// Takes the first reading and starts the thread. `None` if the system cannot start a thread.
    pub fn start() -> Option<Self> {
        let (stop, stopped) = channel();
        let mut gauges = Gauges::find();
        let mut series = gauges.series();
        gauges.read(Instant::now(), &mut series);
        let record = move || {
            let mut pause = PERIOD;
            while !series.is_empty() && stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let now = Instant::now();
                gauges.read(now, &mut series);
                pause = PERIOD.max(now.elapsed() * SHARE);
            }
            series
        };
        let thread = std::thread::Builder::new().name("recorder".into()).spawn(record).ok()?;
        Some(Self { stop, thread })
    }

    /// Stops the thread and returns the readings. Empty if nothing can be read.
    pub fn finish(self) -> Vec<Series> {
        drop(self.stop);
        let mut series = self.thread.join().unwrap_or_default();
        series.retain(|series| !series.points.is_empty());
        series
    }
}

/// All quantities that can be read over time.
struct Gauges {
    clock: Option<Clock>,
    processors: Vec<rapl::Power>,
    devices: Devices,
}

impl Gauges {
    fn find() -> Self {
        Self {
            clock: Clock::find(),
            processors: rapl::Meters::start().into_power(),
            devices: Devices::start(),
        }
    }

    /// An empty series for each number that [`Gauges::read`] reads, in the same order.
    fn series(&self) -> Vec<Series> {
        let series = |name: &str, unit| Series { name: name.to_owned(), unit, points: Vec::new() };
        let clock = self.clock.iter().map(|_| series("cpu clock", "MHz"));
        let processors = self.processors.iter().map(|meter| series(&format!("{} power", meter.name()), "W"));
        let mut all: Vec<Series> = clock.chain(processors).collect();
        for name in self.devices.names() {
            all.extend([series(&format!("{name} clock"), "MHz"), series(&format!("{name} power"), "W")]);
        }
        all
    }

    fn read(&mut self, now: Instant, series: &mut [Series]) {
        let clock = self.clock.iter().map(Clock::mhz);
        let processors = self.processors.iter_mut().map(|meter| meter.watts(now));
        let of_device = |index| [self.devices.mhz(index), self.devices.watts(index)];
        let devices = (0..self.devices.names().len()).flat_map(of_device);
        for (series, number) in series.iter_mut().zip(clock.chain(processors).chain(devices)) {
            series.points.extend(number.map(|number| (now, number)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_read_in_order_and_not_too_often() {
        let began = Instant::now();
        let recorder = Recorder::start().expect("a thread");
        std::thread::sleep(4 * PERIOD);
        let all = recorder.finish();
        let most = 2 + began.elapsed().as_millis() / PERIOD.as_millis();
        for Series { name, points, .. } in &all {
            assert!((1..=most).contains(&(points.len() as u128)), "{name}: {} of {most}", points.len());
            assert!(points.is_sorted_by(|a, b| a.0 < b.0) && points.iter().all(|(_, x)| *x >= 0.0), "{name}");
        }
        let has_clock = all.iter().any(|series| series.name == "cpu clock");
        assert_eq!(has_clock, Clock::find().is_some(), "{all:?}");
    }
}
