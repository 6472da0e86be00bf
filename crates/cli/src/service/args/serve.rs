//! Arguments of the service and of the commands that talk to it.

use crate::args::{OidnArgs, SceneArgs, SpecArgs, UnitArgs};
use crate::logging::{FORMAT, LogFormat};
use clap::parser::ValueSource;
use clap::{Args, FromArgMatches};
use ipnet::IpNet;
use raystream::picture::LightSpec;
use raystream::picture::form::{Form, Seconds};
use raystream_service::contract::Failpoint;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

/// `raystream serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Address to listen at; port 0 is any free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7878")]
    pub listen: SocketAddr,
    /// Folder of all that is kept: scenes, jobs, pictures, the token.
    #[arg(long, value_name = "FOLDER", default_value = "raystream-data")]
    pub data: PathBuf,
    /// Certificate chain for TLS, as a PEM file.
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_certificate: Option<PathBuf>,
    /// Key of the certificate, as a PEM file.
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    pub tls_key: Option<PathBuf>,
    /// Certificates of the authorities by which the storage and https addresses of webhooks are known, as a PEM file
    /// [default: the system's].
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Network that webhooks may call besides public addresses, as 10.0.0.0/8 or 127.0.0.1. Repeatable.
    #[arg(long, value_name = "NETWORK", value_parser = network)]
    pub webhook_network: Vec<IpNet>,
    /// Listen at an address of other machines without TLS.
    #[arg(long)]
    pub insecure: bool,
    /// Render for Drake: programs of this machine may POST to /render without a token.
    #[arg(long)]
    pub drake: bool,
    /// A name by which this service may be called, besides localhost and addresses. Repeatable.
    #[arg(long, value_name = "NAME")]
    pub name: Vec<String>,
    /// Most memory of a scene with its tree, and of the scenes that are kept ready, in bytes or as 500M, 12G; all
    /// scenes together take at most twice as much [default: 7/16 of the machine's].
    #[arg(long, value_name = "BYTES", value_parser = crate::args::bytes)]
    pub memory: Option<u64>,
    /// Most bytes of an upload.
    #[arg(long, value_name = "BYTES", default_value = "2G", value_parser = crate::args::bytes)]
    pub max_upload: u64,
    /// Most bytes of a pack's files.
    #[arg(long, value_name = "BYTES", default_value = "8G", value_parser = crate::args::bytes)]
    pub max_unpacked: u64,
    /// Most connections at the same time.
    #[arg(long, value_name = "N", default_value_t = 4096)]
    pub max_connections: usize,
    /// Most jobs that have not ended.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub max_jobs: u64,
    /// Delete jobs so long after they have ended, and uploads that no job needs so long after they were last used:
    /// 90m, 12h, 30d. Pinned jobs stay [default: never].
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub keep_for: Option<Duration>,
    /// Delete the jobs that ended first while results have more bytes, as 500M or 200G. Pinned jobs stay
    /// [default: no bound].
    #[arg(long, value_name = "BYTES", value_parser = crate::args::bytes)]
    pub keep_bytes: Option<u64>,
    /// Where finished pictures and uploaded scenes lie: s3://BUCKET/PREFIX, with AWS_ACCESS_KEY_ID,
    /// AWS_SECRET_ACCESS_KEY and AWS_REGION of the environment. The data folder keeps the ledger and copies
    /// [default: the data folder].
    #[arg(long, value_name = "URL")]
    pub storage: Option<String>,
    /// Server of the storage, as https://minio.example:9000 [default: that of the environment, or Amazon's].
    #[arg(long, value_name = "URL", requires = "storage")]
    pub storage_endpoint: Option<String>,
    /// Most bytes of copies of what lies in the storage; what is in use goes beyond it.
    #[arg(long, value_name = "BYTES", default_value = "10G", value_parser = crate::args::bytes)]
    pub storage_cache: u64,
    /// Longest time of a request to the storage, of at most 8 MiB, as 30s or 2m. Then it is tried again for up to ten
    /// seconds.
    #[arg(long, value_name = "TIME", default_value = "30s", value_parser = time)]
    pub storage_timeout: Duration,
    /// How long an address works by which its holder reads or writes one object of the storage, as 15m or 1h.
    #[arg(long, value_name = "TIME", default_value = "15m", value_parser = time)]
    pub storage_expiry: Duration,
    /// How long the copy of a scene stays after it was last used, for tests.
    #[arg(long, value_name = "TIME", hide = true, default_value = "10m", value_parser = time)]
    pub storage_rest: Duration,
    /// The library of a denoiser.
    #[command(flatten)]
    pub oidn: OidnArgs,
    /// Show finished pictures, and live views that rest, in tev; tev listens at port 14158.
    #[arg(long, value_name = "HOST:PORT", alias = "display-server")]
    pub tev: Option<String>,
    /// Form of the messages on standard error: text, or lines of JSON.
    #[arg(long, value_name = "FORM", value_enum, default_value_t = LogFormat::Text, env = FORMAT)]
    pub log_format: LogFormat,
    /// Pixels × samples of a unit, for tests.
    #[arg(long, value_name = "N", hide = true)]
    pub unit_samples: Option<u64>,
    /// Longest pause of a client within a request, for tests.
    #[arg(long, value_name = "SECONDS", hide = true, value_parser = Seconds::read)]
    pub patience: Option<Duration>,
    /// Cut units at random, for tests.
    #[arg(long, value_name = "SEED", hide = true)]
    pub random_units: Option<u64>,
    /// Add up the films of a frame when there are so many, for tests.
    #[arg(long, value_name = "N", hide = true)]
    pub most_files: Option<usize>,
    /// End the process at a place, for tests.
    #[arg(long, value_name = "PLACE[:N]", hide = true)]
    pub failpoint: Option<Failpoint>,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
    /// Workers on other machines.
    #[command(flatten)]
    pub farm: super::FarmArgs,
}

/// `raystream view`.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// Scene file: .obj, .gltf, .glb, .ply, .stl, .off, or a .json recipe.
    pub scene: PathBuf,
    /// Start no browser; only print the address.
    #[arg(long)]
    pub no_browser: bool,
    /// The service.
    #[command(flatten)]
    pub service: ServeArgs,
}

/// Options of commands that talk to the service.
#[derive(Clone, Debug, Args)]
pub struct ClientArgs {
    /// Address of the service.
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:7878")]
    pub server: String,
    /// File with the service's token.
    #[arg(long, value_name = "FILE", default_value = "raystream-data/token")]
    pub token_file: PathBuf,
    /// Certificates of the authorities by which an https service is known, as a PEM file [default: the system's].
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `raystream submit`.
#[derive(Clone, Debug, Args)]
pub struct SubmitArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// Name of the request: a second one of the same name gets the job of the first.
    #[arg(long, value_name = "KEY")]
    pub idempotency_key: Option<String>,
    /// Title of the job, by which people know it.
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Label by which the job is found. Repeatable.
    #[arg(long, value_name = "TEXT")]
    pub label: Vec<String>,
    /// Priority of the job: interactive, normal or background.
    #[arg(long, value_name = "NAME", default_value = "normal")]
    pub priority: String,
    /// Scene file. Files that it names must lie in its folder.
    pub scene: PathBuf,
    /// Options of `raystream render`; those above may stand among them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "OPTIONS")]
    pub options: Vec<String>,
}

impl SubmitArgs {
    /// Options of `submit` that stand behind the scene, moved to where they belong.
    ///
    /// # Errors
    /// If one of them has no value, or a wrong one.
    pub fn sorted(&self) -> Result<Self, clap::Error> {
        let command = || Self::augment_args(clap::Command::new("submit").no_binary_name(true));
        let arguments = command();
        let known = |word: &str| {
            let name = word.strip_prefix("--")?.split('=').next()?;
            arguments.get_arguments().find(|argument| argument.get_long() == Some(name))
        };
        let (mut own, mut others) = (Vec::new(), Vec::new());
        let mut words = self.options.iter();
        while let Some(word) = words.next() {
            let Some(argument) = known(word) else {
                others.push(word.clone());
                continue;
            };
            own.push(word.clone());
            if argument.get_action().takes_values() && !word.contains('=') {
                own.extend(words.next().cloned());
            }
        }
        let mut sorted = Self { options: others, ..self.clone() };
        if !own.is_empty() {
            own.push(self.scene.display().to_string());
            let found = command().try_get_matches_from(&own)?;
            let new = Self::from_arg_matches(&found)?;
            let is_given = |name| found.value_source(name) == Some(ValueSource::CommandLine);
            let (client, given) = (&mut sorted.client, new.client);
            if is_given("server") {
                client.server = given.server;
            }
            if is_given("token_file") {
                client.token_file = given.token_file;
            }
            if is_given("priority") {
                sorted.priority = new.priority;
            }
            sorted.title = new.title.or_else(|| sorted.title.take());
            sorted.label.extend(new.label);
            client.json |= given.json;
            client.ca = given.ca.or_else(|| client.ca.take());
            sorted.idempotency_key = new.idempotency_key.or_else(|| sorted.idempotency_key.take());
        }
        Ok(sorted)
    }
}

/// `raystream jobs`.
#[derive(Debug, Args)]
pub struct JobsArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// Show this job alone, with its pictures.
    pub id: Option<String>,
    /// Show jobs of this state: queued, running, paused, done, failed, cancelled.
    #[arg(long, value_name = "STATE")]
    pub state: Option<String>,
    /// Show jobs with this text in their title, a label or their name.
    #[arg(long, value_name = "TEXT")]
    pub text: Option<String>,
    /// Show jobs with this label.
    #[arg(long, value_name = "TEXT")]
    pub label: Option<String>,
}

/// `raystream fetch`.
#[derive(Debug, Args)]
pub struct FetchArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// The job.
    pub id: String,
    /// Picture to write: .png, .exr, .npz or .npy.
    #[arg(short, long, value_name = "FILE", default_value = "out.png")]
    pub output: PathBuf,
    /// The frame.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub frame: u32,
    /// Wait until the job has ended.
    #[arg(long)]
    pub wait: bool,
}

/// `raystream timeline`.
#[derive(Debug, Args)]
pub struct TimelineArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// The job.
    pub id: String,
    /// Timeline to write, as a Chrome trace.
    #[arg(short, long, value_name = "FILE.json", default_value = "timeline.json")]
    pub output: PathBuf,
}

/// `raystream cancel`.
#[derive(Debug, Args)]
pub struct CancelArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// The job.
    pub id: String,
}

/// `raystream delete`.
#[derive(Debug, Args)]
pub struct DeleteArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// The job.
    pub id: String,
}

/// `raystream pin`.
#[derive(Debug, Args)]
pub struct PinArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// The job.
    pub id: String,
    /// Let it be deleted again.
    #[arg(long)]
    pub off: bool,
}

/// Reads a scene and counts its triangles, in a process that the service starts.
#[derive(Debug, Args)]
pub struct CheckSceneArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// The folder that its files lie in.
    #[arg(long, value_name = "FOLDER")]
    pub root: PathBuf,
    /// File to write the loaded scene to.
    #[arg(long, value_name = "FILE")]
    pub flat: Option<PathBuf>,
    /// A picture that a shader of the job looks up. Repeatable.
    #[arg(long, value_name = "FILE")]
    pub picture: Vec<PathBuf>,
    /// Options of reading it.
    #[command(flatten)]
    pub loading: SceneArgs,
    /// Light besides its own.
    #[command(flatten)]
    pub light: SpecArgs<LightSpec>,
}

/// A time as `90m`, `12h` or `30d`.
fn time(text: &str) -> Result<Duration, String> {
    let units = [("s", 1), ("m", 60), ("h", 3600), ("d", 86_400)];
    let seconds = units.iter().find_map(|(unit, seconds)| {
        let count: u64 = text.strip_suffix(unit)?.parse().ok()?;
        count.checked_mul(*seconds).filter(|seconds| (1..=100 * 365 * 86_400).contains(seconds))
    });
    seconds.map(Duration::from_secs).ok_or_else(|| "write a number and s, m, h or d, as in 30d".into())
}

/// A network, or the one address of one.
fn network(text: &str) -> Result<IpNet, String> {
    let address = || text.parse::<IpAddr>().map(IpNet::from);
    let found = text.parse::<IpNet>().or_else(|_| address());
    found.map_err(|_| "write an address, or one with a length of its prefix as 10.0.0.0/8".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(words: &[&str]) -> Result<SubmitArgs, clap::Error> {
        let command = SubmitArgs::augment_args(clap::Command::new("submit").no_binary_name(true));
        SubmitArgs::from_arg_matches(&command.try_get_matches_from(words)?)?.sorted()
    }

    #[test]
    fn times_have_units() {
        for (text, seconds) in [("2s", 2), ("90m", 5400), ("12h", 43_200), ("30d", 2_592_000)] {
            assert_eq!(time(text), Ok(Duration::from_secs(seconds)), "{text}");
        }
        for wrong in ["", "d", "0d", "-1d", "1.5h", "30", "99999999999999999999d", "40000d"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn options_of_submit_stand_anywhere() {
        let both = [
            "--token-file",
            "t",
            "s.glb",
            "--size",
            "8x8",
            "--server",
            "https://a",
            "--json",
            "--spp",
            "4",
            "--label",
            "x",
        ];
        let args = sorted(&both).expect("they are known");
        assert_eq!(args.options, ["--size", "8x8", "--spp", "4"]);
        assert_eq!((&*args.client.server, args.client.json), ("https://a", true));
        assert_eq!(args.label, ["x"]);
        assert_eq!(args.client.token_file, PathBuf::from("t"), "what stands before the scene stays");
        assert_eq!((args.scene, args.priority), (PathBuf::from("s.glb"), "normal".into()));
        let args = sorted(&["s.glb", "--priority=interactive", "--spp=4"]).expect("they are known");
        assert_eq!((args.options, args.priority), (vec!["--spp=4".to_owned()], "interactive".to_owned()));
        assert!(sorted(&["s.glb", "--spp", "4", "--server"]).is_err(), "a value is missing");
    }
}
