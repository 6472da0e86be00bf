//! `raystream farm plan`: what a job takes on farms of many sizes.

use super::plot::{self, Curve};
use crate::Outcome;
use crate::outputs::Outputs;
use crate::service::args::{FarmPlanArgs, JobName};
use crate::sheet::Provenance;
use crate::stats;
use anyhow::{Context, Result, anyhow, bail, ensure};
use raystream_service::plan::{Costs, Farm, FramesJob, PlannedJob, Prediction, measured, predict_all};
use serde::Serialize;
use std::path::Path;

/// A prediction beside that for one machine.
#[derive(Debug, Serialize)]
struct Row {
    #[serde(flatten)]
    prediction: Prediction,
    /// How many times as fast it is as one machine.
    speedup: f64,
    /// The same for each machine; of a live view also for the coordinator, which renders rows of it.
    efficiency: f64,
    /// The load of the busier direction of the coordinator's link, from 0 to 1.
    network_share: f64,
    /// The busiest part besides the machines, and its load.
    busiest: &'static str,
    busiest_share: f64,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Sheet<'a> {
    #[serde(flatten)]
    provenance: Provenance,
    /// Gigabits a second.
    network: f64,
    costs: &'a Costs,
    rows: &'a [Row],
}

/// Runs the command.
pub fn run(args: &FarmPlanArgs) -> Result<Outcome> {
    let outputs = [("--json", args.json.as_deref()), ("--plot", args.plot.as_deref())];
    let inputs = [("the costs", args.costs.as_deref()), ("the job", args.from_job.as_deref())];
    Outputs::check(outputs, inputs)?.make_folders()?;
    if let Some(plot) = &args.plot {
        let is_svg = plot.extension().is_some_and(|extension| extension == "svg");
        ensure!(is_svg, "{}: a plot is written as .svg; give the file this extension", plot.display());
    }
    let from_job = args.from_job.as_deref().map(measure).transpose()?;
    let costs = costs(args, from_job.as_ref().map(|(costs, _)| costs))?;
    let sizes = sizes(&args.machines);
    let mut rows = Vec::new();
    for jobs in jobs(args, from_job.map(|(_, job)| job))? {
        let farms: Vec<Farm> = sizes.iter().map(|machines| farm(args, *machines)).collect();
        let predictions = predict_all(&farms, &costs, &jobs);
        let [one, ..] = &predictions[..] else { bail!("there is no farm") };
        predictions.iter().try_for_each(ensure_done)?;
        let is_asked = |prediction: &&Prediction| {
            args.machines.len() == 1 || args.machines.contains(&prediction.machines)
        };
        rows.extend(predictions.iter().filter(is_asked).map(|prediction| Row::new(prediction.clone(), one)));
    }
    print(&rows);
    if let Some(path) = &args.json {
        let sheet =
            Sheet { provenance: Provenance::here(), network: args.network, costs: &costs, rows: &rows };
        stats::write(path, &sheet)?;
    }
    if let Some(path) = &args.plot {
        plot::write(path, &curves(&rows))?;
    }
    Ok(Outcome::Done)
}

impl Row {
    fn new(prediction: Prediction, one: &Prediction) -> Self {
        let speedup = one.seconds / prediction.seconds;
        let (busiest, busiest_share) = prediction.busiest().map_or(("", 0.0), |load| (load.name, load.share));
        Self {
            speedup,
            efficiency: speedup * one.power / prediction.power,
            network_share: prediction.network_share(),
            busiest,
            busiest_share,
            prediction,
        }
    }
}

fn ensure_done(prediction: &Prediction) -> Result<()> {
    match &prediction.failed {
        Some(why) => bail!("{} on {} machines: {why}", prediction.job, prediction.machines),
        None => Ok(()),
    }
}

/// What a job of the service was, and what it has cost.
fn measure(path: &Path) -> Result<(Costs, FramesJob)> {
    let name = path.display();
    measured(&read(path)?, &Costs::default())
        .map_err(|why| anyhow!("{name}: no timeline of a whole job: {why}"))
}

fn read(path: &Path) -> Result<serde_json::Value> {
    let name = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read"))?;
    serde_json::from_str(&text).with_context(|| format!("{name}: is no JSON"))
}

/// The costs: the defaults, or those of a measured job; then those of a file, then those of options.
fn costs(args: &FarmPlanArgs, of_job: Option<&Costs>) -> Result<Costs> {
    let mut costs = serde_json::to_value(of_job.copied().unwrap_or_default())?;
    if let Some(path) = &args.costs {
        merge(&mut costs, path)?;
    }
    for (name, value) in &args.cost {
        // Counts are whole numbers.
        let is_count = costs[name].is_u64() && value.fract() == 0.0 && *value >= 0.0;
        costs[name] = if is_count { (*value as u64).into() } else { (*value).into() };
    }
    let costs: Costs = serde_json::from_value(costs).context("--cost")?;
    match costs.problem() {
        Some(problem) => bail!("costs: {problem}"),
        None => Ok(costs),
    }
}

/// Takes costs from a file, or from what `--json` has written.
fn merge(costs: &mut serde_json::Value, path: &Path) -> Result<()> {
    let name = path.display();
    let file = read(path)?;
    let file = file.get("costs").unwrap_or(&file);
    let fields = file.as_object().with_context(|| format!("{name}: write an object of costs"))?;
    for (field, value) in fields {
        ensure!(costs.get(field).is_some(), "{name}: there is no cost {field:?}");
        ensure!(value.is_number(), "{name}: {field}: write a number");
        costs[field] = value.clone();
    }
    Ok(())
}

/// The sizes of farms to predict: 1, with which the others are compared, and those that are asked for. One number
/// stands for 1, 2, 5, 10 and so on up to it.
fn sizes(asked: &[u32]) -> Vec<u32> {
    let mut sizes = match *asked {
        [most] => {
            let decades = (0..7).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_u32.pow(power)));
            decades.filter(|size| *size < most).chain([most]).collect()
        }
        _ => asked.to_vec(),
    };
    if sizes.first() != Some(&1) {
        sizes.retain(|size| *size != 1);
        sizes.insert(0, 1);
    }
    sizes
}

/// The jobs, those together that share the farm.
fn jobs(args: &FarmPlanArgs, measured: Option<FramesJob>) -> Result<Vec<Vec<PlannedJob>>> {
    let mut jobs: Vec<PlannedJob> = match measured {
        Some(job) => vec![PlannedJob::Frames(job)],
        None => args.job.iter().map(|name| of_name(*name)).collect(),
    };
    for job in &mut jobs {
        let (size, spp, frames) = match job {
            PlannedJob::Frames(job) => (&mut job.size, &mut job.spp, &mut job.frames),
            PlannedJob::Live(job) => (&mut job.size, &mut job.spp, &mut job.frames),
        };
        *size = args.size.unwrap_or(*size);
        *spp = args.spp.unwrap_or(*spp);
        *frames = args.frames.unwrap_or(*frames);
    }
    if !args.together {
        return Ok(jobs.into_iter().map(|job| vec![job]).collect());
    }
    let is_live = jobs.iter().any(|job| matches!(job, PlannedJob::Live(_)));
    ensure!(!is_live, "--together: a live view has no units; leave it out");
    Ok(vec![jobs])
}

fn of_name(name: JobName) -> PlannedJob {
    match name {
        JobName::Still => PlannedJob::still(),
        JobName::Animation => PlannedJob::animation(),
        JobName::Live => PlannedJob::live(),
    }
}

fn farm(args: &FarmPlanArgs, machines: u32) -> Farm {
    Farm {
        machines,
        network_bits: args.network * 1e9,
        failure_s: args.failures.map(|hours| hours * 3600.0),
        compared: args.compared,
    }
}

fn print(rows: &[Row]) {
    let mut job = "";
    for row in rows {
        let Row { prediction, speedup, efficiency, network_share, busiest, busiest_share } = row;
        if job != prediction.job {
            job = &prediction.job;
            stdout_line!("{job}");
            stdout_line!(
                "  {:>8} {:>12} {:>9} {:>10} {:>7} {:>8}  busiest besides them",
                "machines",
                "seconds",
                "speedup",
                "efficiency",
                "idle",
                "network"
            );
        }
        stdout_line!(
            "  {:>8} {:>12.2} {:>9.2} {:>8.1} % {:>5.1} % {:>6.1} %  {busiest} {:.0} %",
            prediction.machines,
            prediction.seconds,
            speedup,
            100.0 * efficiency,
            100.0 * prediction.idle_share,
            100.0 * network_share,
            100.0 * busiest_share
        );
    }
}

/// The rows by job, for the plot.
fn curves(rows: &[Row]) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for row in rows {
        let (name, machines) = (&row.prediction.job, f64::from(row.prediction.machines));
        if curves.last().is_none_or(|curve| curve.name != *name) {
            curves.push(Curve { name: name.clone(), seconds: Vec::new(), efficiency: Vec::new() });
        }
        if let Some(curve) = curves.last_mut() {
            curve.seconds.push((machines, row.prediction.seconds));
            curve.efficiency.push((machines, row.efficiency));
        }
    }
    curves
}

#[cfg(test)]
mod tests {
    use super::sizes;

    #[test]
    fn one_number_stands_for_all_sizes_up_to_it() {
        assert_eq!(sizes(&[1]), [1]);
        assert_eq!(sizes(&[12]), [1, 2, 5, 10, 12]);
        assert_eq!(sizes(&[100]), [1, 2, 5, 10, 20, 50, 100]);
        assert_eq!(sizes(&[3, 1, 4]), [1, 3, 4]);
    }
}
