//! The arguments of the service's commands.

mod backup;
mod farm;
mod farm_plan;
mod serve;
mod token;

pub use backup::BackupArgs;
pub use farm::{FarmArgs, FarmCommand, FarmInitArgs, FarmKeyArgs, FarmTrustArgs, NatsArgs, WorkerArgs};
pub use farm_plan::{FarmPlanArgs, JobName};
pub use serve::{
    CancelArgs, CheckSceneArgs, ClientArgs, DeleteArgs, FetchArgs, JobsArgs, PinArgs, ServeArgs, SubmitArgs,
    TimelineArgs, ViewArgs,
};
pub use token::{DataArgs, TokenAddArgs, TokenCommand, TokenListArgs, TokenRevokeArgs, TokenRotateArgs};
