//! Arguments of `raystream token`.

use clap::{Args, Subcommand};
use raystream_service::coordinator::ledger::{Role, Token};
use std::path::PathBuf;

/// `raystream token`.
#[derive(Debug, Subcommand)]
pub enum TokenCommand {
    /// Make a token and print it. It is shown this once.
    Add(TokenAddArgs),
    /// List the tokens of a service.
    List(TokenListArgs),
    /// End a token, and the cookies that pages got for it.
    Revoke(TokenRevokeArgs),
    /// Give a token another text and print it. The old one and its cookies end.
    Rotate(TokenRotateArgs),
}

/// The data folder of a service.
#[derive(Debug, Args)]
pub struct DataArgs {
    /// Data folder of the service. It may run meanwhile.
    #[arg(long, value_name = "FOLDER", default_value = "raystream-data")]
    pub data: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `raystream token add`.
#[derive(Debug, Args)]
pub struct TokenAddArgs {
    /// The service.
    #[command(flatten)]
    pub of: DataArgs,
    /// Name of the token: letters, digits, - and _.
    #[arg(value_parser = name)]
    pub name: String,
    /// Tenant whose jobs and scenes it reaches; its tokens share them [default: the token's name].
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub tenant: Option<String>,
    /// Role: metrics, which sees measurements alone; read; submit; admin. Each of the last three may do what those
    /// before it may.
    #[arg(long, value_name = "ROLE", default_value = "submit")]
    pub role: Role,
    /// Most jobs of the tenant that have not ended [default: no bound of its own].
    #[arg(long, value_name = "N")]
    pub max_jobs: Option<u64>,
    /// Most samples (pixels × samples × frames) that are accepted in a day, which begins at midnight UTC
    /// [default: no bound].
    #[arg(long, value_name = "N")]
    pub samples_a_day: Option<u64>,
    /// Most bytes that are sent in a day, as 500M or 12G [default: no bound].
    #[arg(long, value_name = "BYTES", value_parser = crate::args::bytes)]
    pub bytes_a_day: Option<u64>,
    /// Days until it expires [default: never].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: Option<u32>,
    /// File to write it to, which its owner alone may read, instead of printing it.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// `raystream token list`.
#[derive(Debug, Args)]
pub struct TokenListArgs {
    /// The service.
    #[command(flatten)]
    pub of: DataArgs,
}

/// `raystream token revoke`.
#[derive(Debug, Args)]
pub struct TokenRevokeArgs {
    /// The service.
    #[command(flatten)]
    pub of: DataArgs,
    /// Name of the token.
    pub name: String,
    /// End the cookies alone; the token stays.
    #[arg(long)]
    pub cookies: bool,
}

/// `raystream token rotate`.
#[derive(Debug, Args)]
pub struct TokenRotateArgs {
    /// The service.
    #[command(flatten)]
    pub of: DataArgs,
    /// Name of the token.
    pub name: String,
    /// File to write it to, which its owner alone may read, instead of printing it.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

fn name(text: &str) -> Result<String, String> {
    Token::check_name(text).map(|()| text.to_owned())
}
