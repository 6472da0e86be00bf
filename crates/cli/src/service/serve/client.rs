//! The commands that talk to a service.

use crate::args::{Cli, Command};
use crate::service::args::{
    CancelArgs, ClientArgs, DeleteArgs, FetchArgs, JobsArgs, PinArgs, SubmitArgs, TimelineArgs,
};
use crate::{Outcome, command, options_file};
use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::FromArgMatches;
use raystream::files;
use raystream::picture::{Registry, RenderSpec, SpecGroup};
use raystream_service::contract::Pack;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::time::Duration;
use ureq::http::Response;
use ureq::{Agent, Body, RequestBuilder};

/// The pause between two questions of `fetch --wait`.
const POLL: Duration = Duration::from_millis(300);

/// The most bytes of an answer.
const MOST_BYTES: u64 = 1 << 34;

/// A service.
struct Client {
    agent: Agent,
    server: String,
    token: String,
}

impl Client {
    fn new(args: &ClientArgs) -> Result<Self> {
        let path = args.token_file.display();
        let token = std::fs::read_to_string(&args.token_file).with_context(|| {
            format!("{path}: the token cannot be read; name the service's file `token` (--token-file)")
        })?;
        let mut config = Agent::config_builder().http_status_as_error(false).max_redirects(0);
        let server = args.server.trim_end_matches('/').to_owned();
        if server.starts_with("https:") {
            config = config.tls_config(raystream_service::http::roots::tls(args.ca.as_deref())?);
        }
        let agent = config.timeout_connect(Some(Duration::from_secs(10))).build().new_agent();
        Ok(Self { agent, server, token: format!("Bearer {}", token.trim()) })
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.server)
    }

    fn told<B>(&self, request: RequestBuilder<B>) -> RequestBuilder<B> {
        request.header("Authorization", &self.token)
    }

    fn get(&self, path: &str) -> Result<Response<Body>> {
        self.answered(self.told(self.agent.get(self.url(path))).call())
    }

    fn post(&self, path: &str, body: &Value, key: Option<&str>) -> Result<Value> {
        let request = self.told(self.agent.post(self.url(path)));
        let request = key.into_iter().fold(request, |request, key| request.header("Idempotency-Key", key));
        json_of(self.answered(request.send_json(body))?)
    }

    /// The answer, unless it is a refusal.
    fn answered(&self, answer: Result<Response<Body>, ureq::Error>) -> Result<Response<Body>> {
        let mut answer = answer.with_context(|| format!("{}: the service cannot be reached", self.server))?;
        let status = answer.status();
        if status.is_success() {
            return Ok(answer);
        }
        let body = answer.body_mut().read_to_string().unwrap_or_default();
        let problem: Value = serde_json::from_str(&body).unwrap_or_default();
        bail!("{}: {}", self.server, problem["detail"].as_str().unwrap_or(status.as_str()))
    }
}

fn json_of(mut answer: Response<Body>) -> Result<Value> {
    let text = answer.body_mut().with_config().limit(MOST_BYTES).read_to_string()?;
    serde_json::from_str(&text).context("the service does not answer with JSON")
}

/// A text of an answer.
fn text<'a>(value: &'a Value, name: &str) -> &'a str {
    value[name].as_str().unwrap_or_default()
}

/// `raystream submit`.
pub fn submit(args: &SubmitArgs, registry: &Registry) -> Result<Outcome> {
    let args = &args.sorted()?;
    let client = Client::new(&args.client)?;
    let pack = Pack::of(registry, &spec_of(registry, args)?)?;
    let path = format!("/api/v1/scenes/{}", pack.scene.sha256);
    let head = client.told(client.agent.head(client.url(&path))).call();
    if head.map_or(0, |answer| answer.status().as_u16()) != 200 {
        let request = client.told(client.agent.put(client.url(&path)));
        client.answered(request.send(&pack.scene.bytes[..]))?;
    }
    let mut request = serde_json::to_value(&pack.spec)?;
    request["scene"] = json!(pack.scene.sha256);
    request["entry"] = json!(pack.scene.entry);
    request["priority"] = json!(args.priority);
    request["title"] = json!(args.title);
    request["labels"] = json!(args.label);
    let job = client.post("/api/v1/jobs", &request, args.idempotency_key.as_deref())?;
    if args.client.json {
        stdout_line!("{}", json!({ "id": job["id"], "state": job["state"] }));
    } else {
        stdout_line!("job {} is {}", text(&job, "id"), text(&job, "state"));
    }
    Ok(Outcome::Done)
}

/// The render spec of the options that stand behind the scene.
fn spec_of(registry: &Registry, args: &SubmitArgs) -> Result<RenderSpec> {
    let own: Vec<OsString> = args.options.iter().map(OsString::from).collect();
    let command = command(registry);
    let of_picture: Vec<&str> = RenderSpec::options().iter().map(|option| option.name).collect();
    let render = command.find_subcommand("render").context("there is the command `render`")?;
    for arg in render.get_arguments().filter(|arg| options_file::is_given(&own, arg)) {
        let long = arg.get_long().unwrap_or_default();
        if long != "options" && !of_picture.contains(&long) {
            bail!("--{long} is no option of a job; it may have --{}", of_picture.join(", --"));
        }
    }
    // What an options file says of the machine does not travel.
    let first = ["raystream".into(), "render".into(), args.scene.as_os_str().to_owned()];
    let all = first.into_iter().chain(own).collect();
    let arguments = options_file::expand(&command, all).map_err(|error| anyhow!(error))?;
    let matches = command.try_get_matches_from(&arguments.all).map_err(|error| anyhow!(told(&error)))?;
    let Command::Render(mut render) = Cli::from_arg_matches(&matches)?.command else {
        bail!("the options are those of `raystream render`")
    };
    render.complete(arguments.spec);
    Ok((*render.spec).clone())
}

/// The text of clap's error, without hints for terminals.
fn told(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let end = text.find("\n\nUsage").or_else(|| text.find("\n\nFor more")).unwrap_or(text.len());
    text[..end].trim_start_matches("error: ").trim().replace('\n', " ")
}

/// `raystream jobs`.
pub fn jobs(args: &JobsArgs) -> Result<Outcome> {
    let client = Client::new(&args.client)?;
    if let Some(id) = &args.id {
        let job = json_of(client.get(&format!("/api/v1/jobs/{}", checked(id)?))?)?;
        if args.client.json {
            stdout_line!("{job}");
            return Ok(Outcome::Done);
        }
        print(&job);
        for picture in job["pictures"].as_array().into_iter().flatten() {
            let hash = picture["hash"].as_str().unwrap_or("not finished");
            stdout_line!("  frame {} {}  {hash}", picture["frame"], text(picture, "name"));
        }
        let compared = &job["compared"];
        if compared["units"].as_u64() > Some(0) {
            let share = 100.0 * compared["share"].as_f64().unwrap_or(0.0);
            stdout_line!("  compared: {share:.1} % of its units, by {} workers", compared["workers"]);
        }
        return Ok(Outcome::Done);
    }
    let mut asked = vec![("limit", "200".to_owned())];
    for (name, value) in [("state", &args.state), ("text", &args.text), ("label", &args.label)] {
        asked.extend(value.iter().map(|value| (name, value.clone())));
    }
    let mut cursor = None;
    loop {
        let request = client.told(client.agent.get(client.url("/api/v1/jobs")));
        let page = request.query_pairs(asked.iter().cloned().chain(cursor));
        let page = json_of(client.answered(page.call())?)?;
        for job in page["jobs"].as_array().into_iter().flatten() {
            if args.client.json {
                stdout_line!("{job}");
            } else {
                print(job);
            }
        }
        match page["cursor"].as_i64() {
            Some(next) => cursor = Some(("cursor", next.to_string())),
            None => return Ok(Outcome::Done),
        }
    }
}

fn print(job: &Value) {
    stdout_line!(
        "{}  {:<9}  {:5.1} %  {} of {} frames  {}{}{}",
        text(job, "id"),
        text(job, "state"),
        100.0 * job["progress"].as_f64().unwrap_or(0.0),
        job["frames_done"],
        job["frames"],
        text(job, "title"),
        left(job),
        text(job, "error")
    );
    let suspects: Vec<&str> =
        job["suspects"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    if !suspects.is_empty() {
        stdout_line!(
            "  suspect: it has sums of {}, which sent wrong ones; submit it again",
            suspects.join(", ")
        );
    }
}

/// The time that a job still needs, if that is known.
fn left(job: &Value) -> String {
    let seconds = |left: u64| match left {
        0..120 => format!("  {left} s left"),
        120..7200 => format!("  {} min left", left / 60),
        _ => format!("  {} h left", left / 3600),
    };
    job["left_s"].as_u64().map_or_else(String::new, seconds)
}

/// An identifier that is put into an address.
fn checked(id: &str) -> Result<&str> {
    ensure!(!id.is_empty() && id.bytes().all(|byte| byte.is_ascii_alphanumeric()), "{id:?} is no job");
    Ok(id)
}

/// `raystream fetch`.
pub fn fetch(args: &FetchArgs) -> Result<Outcome> {
    let id = checked(&args.id)?;
    let extension = args.output.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    ensure!(
        ["png", "exr", "npz", "npy"].contains(&extension),
        "{}: a service has pictures as .png, .exr, .npz and .npy",
        args.output.display()
    );
    files::check_writable(&args.output)?;
    files::make_folder(&args.output)?;
    let client = Client::new(&args.client)?;
    loop {
        let job = json_of(client.get(&format!("/api/v1/jobs/{id}"))?)?;
        let state = text(&job, "state");
        match state {
            "done" => break,
            "queued" | "running" | "paused" if args.wait => std::thread::sleep(POLL),
            "failed" => bail!("job {id} failed: {}", text(&job, "error")),
            // A frame may be finished before its job.
            _ => break,
        }
    }
    let mut answer = client.get(&format!("/api/v1/jobs/{id}/frames/{}.{extension}", args.frame))?;
    let bytes = answer.body_mut().with_config().limit(MOST_BYTES).read_to_vec()?;
    write(&args.output, &bytes)?;
    stdout_line!("{}: frame {} of job {id}, {} bytes", args.output.display(), args.frame, bytes.len());
    Ok(Outcome::Done)
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(files::write(path, |file| file.write_all(bytes))?)
}

/// `raystream timeline`.
pub fn timeline(args: &TimelineArgs) -> Result<Outcome> {
    let (id, path) = (checked(&args.id)?, args.output.display());
    let is_json = args.output.extension().is_some_and(|extension| extension == "json");
    ensure!(is_json, "{path}: a timeline is written as .json; give the file this extension");
    files::check_writable(&args.output)?;
    files::make_folder(&args.output)?;
    let client = Client::new(&args.client)?;
    let trace = json_of(client.get(&format!("/api/v1/jobs/{id}/timeline"))?)?;
    write(&args.output, trace.to_string().as_bytes())?;
    let (units, workers) = (&trace["otherData"]["units"], &trace["otherData"]["workers"]);
    stdout_line!("{path}: {units} units by {workers} workers; open it in Perfetto or chrome://tracing");
    Ok(Outcome::Done)
}

/// `raystream cancel`.
pub fn cancel(args: &CancelArgs) -> Result<Outcome> {
    let id = checked(&args.id)?;
    let client = Client::new(&args.client)?;
    let answer = client.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}), None)?;
    if args.client.json {
        stdout_line!("{answer}");
        return Ok(Outcome::Done);
    }
    let frames = answer["kept"]["frames"].as_array().map_or(0, Vec::len);
    let (units, all) = (&answer["kept"]["units"], &answer["kept"]["of_units"]);
    stdout_line!("job {id} is {}; kept: {frames} frames, {units} of {all} units", text(&answer, "state"));
    Ok(Outcome::Done)
}

/// `raystream delete`.
pub fn delete(args: &DeleteArgs) -> Result<Outcome> {
    let id = checked(&args.id)?;
    let client = Client::new(&args.client)?;
    let request = client.told(client.agent.delete(client.url(&format!("/api/v1/jobs/{id}"))));
    client.answered(request.call())?;
    if args.client.json {
        stdout_line!("{}", json!({ "id": id }));
    } else {
        stdout_line!("job {id} is deleted");
    }
    Ok(Outcome::Done)
}

/// `raystream pin`.
pub fn pin(args: &PinArgs) -> Result<Outcome> {
    let id = checked(&args.id)?;
    let client = Client::new(&args.client)?;
    let verb = if args.off { "unpin" } else { "pin" };
    let answer = client.post(&format!("/api/v1/jobs/{id}/{verb}"), &json!({}), None)?;
    if args.client.json {
        stdout_line!("{answer}");
    } else {
        stdout_line!("job {id} is {}", if args.off { "not pinned" } else { "pinned" });
    }
    Ok(Outcome::Done)
}

/// `raystream farm trust`.
pub fn trust(args: &crate::service::args::FarmTrustArgs) -> Result<Outcome> {
    let client = Client::new(&args.client)?;
    let listed = json_of(client.get("/api/v1/workers")?)?;
    let workers = listed["workers"].as_array().into_iter().flatten();
    let is_meant = |worker: &&Value| [text(worker, "name"), text(worker, "key")].contains(&&*args.worker);
    let keys: Vec<&str> = workers.filter(is_meant).map(|worker| text(worker, "key")).collect();
    let key = match *keys {
        [] => bail!("{}: there is no worker of this name or key", args.worker),
        [key] => key,
        _ => {
            bail!("{}: several workers have this name; name the key of one: {}", args.worker, keys.join(", "))
        }
    };
    let answer = client.post(&format!("/api/v1/workers/{key}/trust"), &json!({}), None)?;
    if args.client.json {
        stdout_line!("{answer}");
    } else {
        stdout_line!("worker {} gets units again", args.worker);
    }
    Ok(Outcome::Done)
}
