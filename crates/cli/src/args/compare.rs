//! `raystream compare`.

use super::SpecArgs;
use clap::Args;
use raystream::compare::Metric;
use raystream::picture::LookSpec;
use std::path::PathBuf;

/// `raystream compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture that is right: .png, .exr, .hdr or .npy.
    pub reference: PathBuf,
    /// The picture that is compared with it, of the same size.
    pub test: PathBuf,
    /// Metrics, separated by commas: mse and relmse of linear radiance; psnr, ssim and flip of the picture as it is
    /// shown.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = Metric::ALL)]
    pub metric: Vec<Metric>,
    /// End with exit code 1 if a metric is greater than this (repeatable).
    #[arg(long, value_name = "METRIC=VALUE", value_parser = limit)]
    pub max: Vec<(Metric, f64)>,
    /// End with exit code 1 if a metric is less than this (repeatable).
    #[arg(long, value_name = "METRIC=VALUE", value_parser = limit)]
    pub min: Vec<(Metric, f64)>,
    /// Write a picture of the difference: FLIP's errors as .png, or test − reference in radiance as .exr or .npy.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// The look of radiance.
    #[command(flatten)]
    pub look: SpecArgs<LookSpec>,
}

fn limit(text: &str) -> Result<(Metric, f64), String> {
    let (metric, value) = text.split_once('=').ok_or("write METRIC=VALUE, as in flip=0.05")?;
    let value = value.parse::<f64>().ok().filter(|value| !value.is_nan());
    let value = value.ok_or_else(|| format!("write a number after {metric}="))?;
    Ok((metric.parse().map_err(|error: raystream::compare::UnknownMetric| error.to_string())?, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_name_a_metric_and_a_number() {
        assert_eq!(limit("flip=0.05"), Ok((Metric::Flip, 0.05)));
        assert_eq!(limit("mse=1e-3"), Ok((Metric::Mse, 1e-3)));
        for bad in ["flip", "flip=", "flip=NaN", "difference=1"] {
            assert!(limit(bad).is_err(), "{bad}");
        }
    }
}
