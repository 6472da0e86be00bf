//! `raystream bench live`.

use crate::args::BenchLiveArgs;
use crate::sheet::write;
use anyhow::Result;
use raystream::picture::RenderSpec;
use raystream::schedule::{Service, ServiceOptions};
use raystream_service::contract::Pose;
use raystream_service::live::ViewScene;
use raystream_service::live::speed::{Options, run as measure};
use std::sync::Arc;
use std::time::Duration;

/// Measures a live view.
pub fn run(args: &BenchLiveArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let options = Options { poses: args.poses as usize, moving: Duration::from_secs(args.seconds.into()) };
    let service = ServiceOptions::default().with_host_threads(setup.service.host_threads());
    let service = Arc::new(Service::new(service)?);
    let mut spec = RenderSpec::default();
    (spec.size, spec.stop.spp) = (args.size, Some(args.spp));
    let stage = ViewScene::new("bench", Arc::new(setup.prepared.clone()), service).with_spec(spec);
    let row = measure(stage, Pose::from(&camera), &options)?;
    stdout_line!(
        "first frame of a pose   {:>8.1} ms ({:.1} to {:.1})",
        row.first_ms.median,
        row.first_ms.best,
        row.first_ms.worst
    );
    stdout_line!(
        "while moving            {:>8.1} frames/s, {:.0} % of width and height",
        row.frames_per_s,
        100.0 * row.share
    );
    stdout_line!(
        "{:>4} spp after stopping {:>9.2} s ({:.2} to {:.2})",
        row.spp,
        row.full_s.median,
        row.full_s.best,
        row.full_s.worst
    );
    write(args.shot.json.as_deref(), Some(&args.scene), &[row])
}
