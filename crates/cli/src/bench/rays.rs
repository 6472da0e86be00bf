//! `raystream bench rays`.

use super::super::args::{BenchRaysArgs, SceneView};
use super::super::{printing, stats};
use super::{Provenance, SceneRow, open};
use anyhow::Result;
use raystream::engine::{UnitChoice, Units};
use raystream::lanes::SimdLevel;
use raystream::scene::Camera;
use raystream::schedule::Unit;
use raystream_bench::rays::{Agreement, Options, Report, Row, Summary, run as measure, summarise};
use raystream_bench::{Peers, Workload};
use serde::Serialize;

/// Contenders whose ratios are summarised.
const SUMMARISED: [&str; 3] = ["raystream", "raystream query", "raystream service"];

/// What `--json` writes.
#[derive(Serialize)]
struct Sheet<'a> {
    #[serde(flatten)]
    provenance: Provenance,
    rows: Vec<SceneRow<'a, Row>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    agreement: Vec<SceneRow<'a, Agreement>>,
    /// Over all scenes, where there are several, beside the libraries that take part.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    summary: &'a [Summary],
}

/// Measures the CPU tracer beside its peers, and a GPU if one is named, in one scene after the other.
pub fn run(args: &BenchRaysArgs) -> Result<()> {
    let units = match &args.adapter {
        None => Units::cpu(),
        Some(adapter) => Units::open(&UnitChoice::auto().with_unit(Unit::Hybrid).with_adapter(adapter))?,
    };
    let asked: Vec<SimdLevel> = args.simd.iter().map(|s| SimdLevel::choose(s)).collect::<Result<_, _>>()?;
    let levels = if asked.is_empty() { SimdLevel::available() } else { asked };
    let (rounds, threads) = (args.peers.rounds as usize, args.peers.thread_counts());
    let options = Options { rounds, threads, levels, ..Options::default() };
    let libraries = args.peers.libraries.load()?;
    let mut reports = Vec::new();
    for view in &args.scenes {
        if printing::is_unread() && args.peers.json.is_none() {
            return Ok(());
        }
        let report = one_scene(view, args, &units, libraries.peers(), &options)?;
        print(view, &report);
        if let (Some(adapter), false) = (&args.adapter, report.has_kernel_times()) {
            stdout_line!(
                "the adapter {adapter:?} has no timestamps: its kernels are not timed by themselves"
            );
        }
        reports.push((name(view), report));
    }
    let rows: Vec<(&str, &[Row])> = reports.iter().map(|(scene, report)| (&**scene, &*report.rows)).collect();
    let mut summary = Vec::new();
    if rows.len() > 1 {
        let peers = ["embree", "embree_robust", "tinybvh"];
        summary.extend(peers.into_iter().flat_map(|peer| summarise(&rows, peer)));
        summary.retain(|summary| SUMMARISED.contains(&&*summary.unit));
        print_summary(&summary);
    }
    let Some(path) = &args.peers.json else { return Ok(()) };
    let rows = reports.iter().flat_map(|(scene, report)| SceneRow::all(Some(scene), &report.rows));
    let agreement = reports.iter().flat_map(|(scene, report)| SceneRow::all(Some(scene), &report.agreement));
    let (rows, agreement) = (rows.collect(), agreement.collect());
    stats::write(path, &Sheet { provenance: Provenance::here(), rows, agreement, summary: &summary })
}

fn one_scene(
    view: &SceneView,
    args: &BenchRaysArgs,
    units: &Units,
    peers: Peers<'_>,
    options: &Options,
) -> Result<Report> {
    let prepared = open(&view.scene, units)?;
    let (width, height) = args.size;
    let bounds = prepared.scene.bounds();
    let framed = || Camera::framing(&bounds, width as f32 / height as f32);
    let camera = view.camera(&args.camera, prepared.scene.camera, framed);
    let workload =
        Workload::new(&prepared.scene, &prepared.bvh, &*prepared.tracers.host, &camera, args.size)?;
    Ok(measure(&prepared, &workload, peers, options)?)
}

/// The scene's name in reports.
fn name(view: &SceneView) -> String {
    view.scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn print(view: &SceneView, report: &Report) {
    stdout_line!("{}", view.scene.display());
    stdout_line!(
        "{:<16} {:<40} {:<8} {:>7} {:>9} {:>9} {:>9}  ratio to",
        "rays",
        "unit",
        "order",
        "threads",
        "Mray/s",
        "best",
        "worst"
    );
    for row in &report.rows {
        let ratios: Vec<String> = row.ratio.iter().map(|(peer, r)| format!("{peer} {r:.2}")).collect();
        let speed = row.mray_per_s;
        stdout_line!(
            "{:<16} {:<40} {:<8} {:>7} {:>9.2} {:>9.2} {:>9.2}  {}",
            row.kind.name(),
            unit(&row.unit, row.simd),
            row.order.name(),
            row.threads,
            speed.median,
            speed.best,
            speed.worst,
            ratios.join(", ")
        );
    }
    if report.rows.iter().any(|row| row.alpha_test) {
        stdout_line!("all rays with the alpha test of the scene's masks");
    }
    for agreement in &report.agreement {
        stdout_line!(
            "{}: {} of {} rays differ from Embree's robust mode in hit or miss, {} in distance",
            agreement.kind.name(),
            agreement.hit_or_miss,
            agreement.rays,
            agreement.distance
        );
    }
}

fn print_summary(summaries: &[Summary]) {
    stdout_line!(
        "{:<16} {:<30} {:>7} {:>13} {:>6} {:>14} {:>6}  in",
        "rays",
        "unit",
        "threads",
        "ratio to",
        "scenes",
        "geometric mean",
        "least"
    );
    for summary in summaries {
        stdout_line!(
            "{:<16} {:<30} {:>7} {:>13} {:>6} {:>14.2} {:>6.2}  {}",
            summary.kind.name(),
            unit(&summary.unit, summary.simd),
            summary.threads,
            summary.peer,
            summary.scenes,
            summary.geometric_mean,
            summary.least,
            summary.least_scene
        );
    }
}

fn unit(unit: &str, simd: Option<&str>) -> String {
    simd.map_or_else(|| unit.to_owned(), |simd| format!("{unit} {simd}"))
}
