//! Arguments of `raystream farm plan`.

use clap::{Args, ValueEnum};
use raystream::picture::form::{Form, Size};
use raystream_service::plan::Costs;
use serde_json::Value;
use std::path::PathBuf;

/// A job whose figures are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum JobName {
    /// A still of 1920x1080 pixels with 4096 samples in each.
    Still,
    /// 1000 frames of 1920x1080 pixels with 256 samples in each.
    Animation,
    /// 100 frames of a live view of 1280x720 pixels with one sample in each.
    Live,
}

/// `raystream farm plan`.
#[derive(Debug, Args)]
pub struct FarmPlanArgs {
    /// Machines: one number stands for 1, 2, 5, 10 and so on up to it, several stand for themselves.
    #[arg(long, value_name = "N[,N..]", default_value = "10000", value_delimiter = ',',
        value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub machines: Vec<u32>,
    /// Gigabits a second of each link, in each direction.
    #[arg(long, value_name = "GBIT", default_value_t = 1.0, value_parser = gigabits)]
    pub network: f64,
    /// Jobs, each predicted by itself.
    #[arg(long, value_name = "NAME[,NAME..]", value_delimiter = ',', default_value = "still")]
    pub job: Vec<JobName>,
    /// Let all jobs share the farm at the same time.
    #[arg(long)]
    pub together: bool,
    /// A job of the service that has ended, as `raystream timeline` writes it: its picture, and what its units cost.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["job", "together"])]
    pub from_job: Option<PathBuf>,
    /// Size of the pictures, instead of the job's.
    #[arg(long, value_name = "WxH", value_parser = Size::read)]
    pub size: Option<(u32, u32)>,
    /// Samples of each pixel, instead of the job's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    pub spp: Option<u32>,
    /// Number of pictures, instead of the job's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: Option<u32>,
    /// Costs, as --json shows them; fields that are not there have their defaults.
    #[arg(long, value_name = "FILE.json")]
    pub costs: Option<PathBuf>,
    /// One of these costs. Repeatable.
    #[arg(long, value_name = "NAME=VALUE", value_parser = cost)]
    pub cost: Vec<(String, f64)>,
    /// Mean time between two failures of a machine, in hours [default: none fails].
    #[arg(long, value_name = "HOURS", value_parser = hours)]
    pub failures: Option<f64>,
    /// Share of the units that two workers render and that are compared.
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = super::farm::share)]
    pub compared: f64,
    /// Write all figures as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
    /// Draw time and efficiency over the number of machines.
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
}

fn positive(text: &str, most: f64) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| *value > 0.0 && *value <= most)
}

fn gigabits(text: &str) -> Result<f64, String> {
    positive(text, 1e6).ok_or_else(|| "write gigabits a second, as 0.1 or 10".into())
}

fn hours(text: &str) -> Result<f64, String> {
    positive(text, 1e6).ok_or_else(|| "write hours, as 0.5 or 1000".into())
}

/// A field of [`Costs`] and its value.
fn cost(text: &str) -> Result<(String, f64), String> {
    let costs = serde_json::to_value(Costs::default()).map_err(|error| error.to_string())?;
    let names = costs.as_object().into_iter().flat_map(|costs| costs.keys().cloned());
    let names: Vec<String> = names.collect();
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE")?;
    if !costs.get(name).is_some_and(Value::is_number) {
        return Err(format!("there is no cost {name:?}; there are {}", names.join(", ")));
    }
    let value = value.parse().map_err(|_| format!("{value:?} is no number"))?;
    Ok((name.to_owned(), value))
}
