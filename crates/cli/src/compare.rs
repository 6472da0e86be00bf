//! `raystream compare`.

use super::Outcome;
use super::args::CompareArgs;
use super::outputs::Outputs;
use super::stats::SCHEMA;
use anyhow::{Result, ensure};
use raystream::compare::{Metric, Pair, flip_colours, radiance_difference};
use raystream::film::{Format, Look, View, read_image, write_image};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Compares two pictures.
pub fn run(args: &CompareArgs) -> Result<Outcome> {
    let inputs = [("the reference", Some(&*args.reference)), ("the test picture", Some(&*args.test))];
    Outputs::check([("-o", args.output.as_deref())], inputs)?.make_folders()?;
    let format = args.output.as_deref().map(Format::of).transpose()?;
    let mut metrics = args.metric.clone();
    metrics.extend(args.max.iter().chain(&args.min).map(|limit| limit.0));
    let pair = Pair::new(read_image(&args.reference)?, read_image(&args.test)?, &args.look.look())?;
    let mut values = BTreeMap::new();
    for metric in metrics {
        values.insert(metric, pair.measure(metric)?);
    }
    let report = Report::new(args, values);
    if let (Some(path), Some(format)) = (&args.output, format) {
        write_difference(path, format, &pair)?;
    }
    report.print(args)?;
    Ok(if report.failed.is_empty() { Outcome::Done } else { Outcome::Degraded })
}

fn write_difference(path: &Path, format: Format, pair: &Pair) -> Result<()> {
    ensure!(
        matches!(format, Format::Png | Format::Exr | Format::Npy),
        "{}: differences are written as .png (FLIP's errors), .exr or .npy (radiance); they may be negative",
        path.display()
    );
    let image = if format == Format::Png { flip_colours(pair) } else { radiance_difference(pair) };
    Ok(write_image(path, &image, &Look::default().with_view(View::Raw))?)
}

/// What is printed.
#[derive(Serialize)]
struct Report {
    schema: u32,
    reference: String,
    test: String,
    /// `null` is infinity.
    metrics: BTreeMap<&'static str, f64>,
    /// Limits that are not kept.
    failed: Vec<String>,
}

impl Report {
    fn new(args: &CompareArgs, values: BTreeMap<Metric, f64>) -> Self {
        let name = |path: &Path| path.display().to_string();
        let over = args.max.iter().filter(|(metric, most)| values[metric] > *most);
        let under = args.min.iter().filter(|(metric, least)| values[metric] < *least);
        let over = over.map(|(metric, most)| format!("{metric} is {}, more than {most}", values[metric]));
        let under = under.map(|(metric, least)| format!("{metric} is {}, less than {least}", values[metric]));
        Self {
            schema: SCHEMA,
            reference: name(&args.reference),
            test: name(&args.test),
            failed: over.chain(under).collect(),
            metrics: values.into_iter().map(|(metric, value)| (metric.name(), value)).collect(),
        }
    }

    fn print(&self, args: &CompareArgs) -> Result<()> {
        if args.json {
            stdout_line!("{}", serde_json::to_string_pretty(self)?);
            return Ok(());
        }
        for metric in Metric::ALL {
            if let Some(value) = self.metrics.get(metric.name()) {
                stdout_line!("{metric} {value}");
            }
        }
        for failed in &self.failed {
            stderr_line!("{failed}");
        }
        Ok(())
    }
}
