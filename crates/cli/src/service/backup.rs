//! `raystream backup` and `raystream restore`.

use crate::Outcome;
use crate::service::args::{BackupArgs, DataArgs};
use anyhow::Result;
use raystream_service::coordinator::{self, Copied};
use serde_json::json;

/// `raystream backup`.
pub fn backup(args: &BackupArgs) -> Result<Outcome> {
    let copied = coordinator::backup(&args.of.data, &args.folder)?;
    tell(&args.of, copied)
}

/// `raystream restore`.
pub fn restore(args: &BackupArgs) -> Result<Outcome> {
    let copied = coordinator::restore(&args.folder, &args.of.data)?;
    tell(&args.of, copied)
}

fn tell(of: &DataArgs, copied: Copied) -> Result<Outcome> {
    let Copied { jobs, scenes, bytes } = copied;
    if of.json {
        stdout_line!("{}", json!({ "jobs": jobs, "scenes": scenes, "bytes": bytes }));
    } else {
        stdout_line!("{jobs} jobs, {scenes} scenes, {bytes} bytes");
    }
    Ok(Outcome::Done)
}
