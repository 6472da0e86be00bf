//! What a stolen key of a worker can do on the bus: speak for itself, and hear what is meant for it.

use crate::secured::Farm;
use crate::{Nats, coordinator, folder, shipped, still};
use async_nats::client::Request;
use async_nats::{Client, ConnectOptions, Event, Subscriber};
use futures_util::StreamExt;
use nkeys::KeyPair;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// A connection with the key of a process of a farm.
pub struct Thief {
    client: Client,
    /// What the server has refused.
    refused: Arc<Mutex<Vec<String>>>,
    inbox: String,
    key: String,
    /// Where answers to what it says come in, and how much it has said.
    answers: Subscriber,
    said: u64,
}

fn seed(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("nats.key")).expect("a key").trim().to_owned()
}

fn public_key(folder: &Path) -> String {
    KeyPair::from_seed(&seed(folder)).expect("a seed").public_key()
}

impl Thief {
    pub async fn new(url: &str, folder: &Path) -> Self {
        let refused = Arc::new(Mutex::new(Vec::new()));
        let (key, list) = (public_key(folder), Arc::clone(&refused));
        let inbox = format!("_INBOX.{key}");
        let options = ConnectOptions::with_nkey(seed(folder))
            .add_root_certificates(folder.join("ca.pem"))
            .require_tls(true)
            .custom_inbox_prefix(&inbox)
            .event_callback(move |event| {
                let list = Arc::clone(&list);
                async move {
                    if let Event::ServerError(error) = event {
                        list.lock().expect("no holder panics").push(error.to_string().to_lowercase());
                    }
                }
            });
        let client = options.connect(url).await.expect("a connection");
        let answers = client.subscribe(format!("{inbox}.answers.*")).await.expect("its own inbox");
        Self { client, refused, inbox, key, answers, said: 0 }
    }

    /// Asks the coordinator, and returns what answers come until there are none for a while.
    pub async fn ask_all(&mut self, kind: &str, messages: Vec<Vec<u8>>, quiet: Duration) -> Vec<Vec<u8>> {
        let (count, mut answers) = (messages.len(), Vec::new());
        for message in messages {
            let to = format!("{}.answers.{}", self.inbox, self.said);
            self.said += 1;
            let subject = format!("raystream.ask.{kind}.{}", self.key);
            self.client.publish_with_reply(subject, to, message.into()).await.expect("it is sent");
        }
        // Without the server there are no answers.
        let _ = tokio::time::timeout(quiet, self.client.flush()).await;
        while answers.len() < count
            && let Ok(Some(answer)) = tokio::time::timeout(quiet, self.answers.next()).await
        {
            answers.push(answer.payload.to_vec());
        }
        answers
    }

    /// Waits for a unit as a worker may. Returns it with its token.
    pub async fn lease(&mut self) -> Value {
        let (began, wait) = (Instant::now(), Duration::from_secs(2));
        loop {
            assert!(began.elapsed() < Duration::from_secs(60), "there is no unit");
            if let Some(leased) = self.try_lease(wait).await {
                return leased;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Joins as a worker may, and asks for a unit. Returns it with its token, if there is one and the answers come in
    /// time.
    pub async fn try_lease(&mut self, wait: Duration) -> Option<Value> {
        let build = serde_json::to_value(raystream_service::contract::Build::own()).expect("JSON");
        let card = json!({
            "worker": "thief", "host": "h", "build": build, "session": 1, "slots": 2, "units": "CPU",
            "is_live": false,
        });
        self.ask_all("join", vec![question(&json!({ "Join": card }))], wait).await;
        let wanted = question(&json!({ "Lease": { "session": 1, "have": [] } }));
        let answers = self.ask_all("lease", vec![wanted], wait).await;
        let answer: Value = serde_json::from_slice(&answers.first()?[4..]).ok()?;
        let leased = &answer["Answer"]["Granted"]["Unit"];
        leased.is_object().then(|| leased.clone())
    }

    /// Says of units of others that they fail, with the token of one of its own if it has had one, until it is told to
    /// end.
    pub async fn accuse(&mut self, is_over: &AtomicBool) {
        let none = json!({ "job": "a", "frame": 0, "round": 0, "pass": 0, "number": 0, "copy": 0 });
        let (wait, mut leased) = (Duration::from_millis(300), json!({ "unit": { "id": none }, "token": "" }));
        while !is_over.load(Relaxed) {
            leased = self.try_lease(wait).await.unwrap_or(leased);
            let accused = |number: u32| {
                let mut unit = leased["unit"]["id"].clone();
                unit["number"] = json!(unit["number"].as_u64().map_or(0, |own| own ^ u64::from(number)));
                let held = json!({ "unit": unit, "token": leased["token"] });
                question(&json!({ "Failure": { "held": held, "error": "it is broken" } }))
            };
            let messages: Vec<Vec<u8>> = (1..8).map(accused).collect();
            self.ask_all("failure", messages, wait).await;
        }
    }

    /// Waits until the server has refused something.
    async fn is_refused(&self, what: &str, subject: &str) {
        let (began, says) = (Instant::now(), format!("{what} \"{subject}\"").to_lowercase());
        while !self.refused.lock().expect("no holder panics").iter().any(|told| told.contains(&says)) {
            assert!(began.elapsed() < Duration::from_secs(5), "the server allows: {says}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    async fn may_not_publish(&self, subject: &str) {
        self.client.publish(subject.to_owned(), "{}".into()).await.expect("it is sent");
        self.is_refused("publish to", subject).await;
    }

    async fn may_not_subscribe(&self, subject: &str) -> Subscriber {
        let subscribed = self.client.subscribe(subject.to_owned()).await.expect("it is sent");
        self.is_refused("subscription to", subject).await;
        subscribed
    }

    /// Publishes what a worker may, with an answer to a subject of its choice.
    async fn publish(&self, subject: &str, answer_to: &str, payload: &str) {
        let payload = payload.to_owned().into();
        let published = self.client.publish_with_reply(subject.to_owned(), answer_to.to_owned(), payload);
        published.await.expect("it is sent");
    }
}

/// A question of a worker, as bytes.
fn question(ask: &Value) -> Vec<u8> {
    let text = json!({ "ask": ask, "part": null }).to_string();
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

/// Everything that a worker has no business with, each refused by name.
async fn try_what_is_not_allowed(thief: &Thief, key_of_other: &str) -> Vec<Subscriber> {
    let other = format!("_INBOX.{key_of_other}");
    let api = |what: &str| format!("$JS.API.{what}");
    for subject in [
        // To ask as another worker, or as an older one without a key.
        format!("raystream.ask.join.{key_of_other}"),
        format!("raystream.ask.result.{key_of_other}"),
        format!("raystream.ask.failure.{key_of_other}"),
        format!("raystream.ask.leave.{key_of_other}"),
        "raystream.ask.join".into(),
        format!("raystream.ask.join.{}.more", thief.key),
        // To wake all workers again and again.
        "raystream.bell".into(),
        api("STREAM.CREATE.MINE"),
        api("ACCOUNT.PURGE.COORDINATOR"),
        api("INFO"),
        "$SYS.REQ.SERVER.PING".into(),
        "raystream.anything".into(),
        // To ask another worker, or itself, for a tile.
        format!("raystream.live.{key_of_other}"),
        format!("raystream.live.{}", thief.key),
        format!("{other}.1"),
        "_R_.1".into(),
    ] {
        thief.may_not_publish(&subject).await;
    }
    let mut listening = Vec::new();
    for subject in [
        ">",
        "raystream.>",
        "raystream.ask.*.*",
        &format!("raystream.ask.result.{key_of_other}"),
        &format!("raystream.ask.result.{}", thief.key),
        "_INBOX.>",
        &format!("{other}.>"),
        // What another worker is asked.
        &format!("raystream.live.{key_of_other}"),
        "raystream.live.*",
        "_R_.>",
        "$JS.>",
        "$SYS.>",
    ] {
        listening.push(thief.may_not_subscribe(subject).await);
    }
    listening
}

/// What a worker may ask, with answers to subjects at which they would do harm.
async fn have_others_do_it(thief: &Thief, key_of_other: &str) {
    for target in [
        "raystream.bell".into(),
        format!("raystream.ask.leave.{key_of_other}"),
        format!("raystream.live.{key_of_other}"),
        format!("_INBOX.{key_of_other}.1"),
    ] {
        for kind in ["join", "report", "lease", "back", "files", "file", "result", "failure"] {
            thief.publish(&format!("raystream.ask.{kind}.{}", thief.key), &target, "").await;
        }
        let asked = question(&json!("Leave"));
        let subject = format!("raystream.ask.leave.{}", thief.key);
        let published = thief.client.publish_with_reply(subject, target, asked.into());
        published.await.expect("it is sent");
    }
    thief.client.flush().await.expect("all is sent");
}

#[test]
fn a_stolen_key_speaks_for_no_other_and_reads_nothing() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    let (thief, mut listening) = runtime.block_on(async {
        let thief = Thief::new(&farm.url, &farm.of("workers/worker-1")).await;
        let other = public_key(&farm.of("workers/worker-2"));
        let listening = try_what_is_not_allowed(&thief, &other).await;
        have_others_do_it(&thief, &other).await;
        (thief, listening)
    });
    // It listens while another worker renders.
    let _worker = farm.worker("worker-2");
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
    let workers = service.get("/api/v1/workers").json();
    assert_eq!(workers["workers"].as_array().map(Vec::len), Some(1), "no one has made it leave: {workers}");
    assert!(thief.client.server_info().client_id > 0, "{}", thief.inbox);
    for subscriber in &mut listening {
        let heard = runtime
            .block_on(async { tokio::time::timeout(Duration::from_millis(10), subscriber.next()).await });
        assert!(!matches!(heard, Ok(Some(_))), "{heard:?}");
    }
}

#[test]
fn a_key_that_floods_is_answered_so_often_and_delays_no_one() {
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    runtime.block_on(async {
        let mut thief = Thief::new(&farm.url, &farm.of("workers/worker-1")).await;
        let mut honest = Thief::new(&farm.url, &farm.of("workers/worker-2")).await;
        let (began, wait) = (Instant::now(), Duration::from_secs(2));
        let leave = || question(&json!("Leave"));
        let (mut rounds, mut answered, mut slowest) = (0, 0, Duration::ZERO);
        while began.elapsed() < Duration::from_secs(4) {
            answered += thief.ask_all("leave", vec![leave(); 8], wait).await.len();
            let asked = Instant::now();
            rounds += 1;
            if rounds % 32 == 1 {
                assert_eq!(honest.ask_all("leave", vec![leave()], wait).await.len(), 1, "it is not answered");
                slowest = slowest.max(asked.elapsed());
            }
        }
        let most = 1000.0 + 500.0 * began.elapsed().as_secs_f32();
        assert!((answered as f32) < most + 8.0, "{answered} of one are answered, at most {most}");
        assert!(answered > 1000, "{answered} are answered at once and in some seconds");
        println!("{answered} of the one that floods; the other waits {slowest:?} at most");
    });
    drop(service);
}

#[test]
fn a_worker_that_is_asked_for_a_tile_answers_once_and_only_there() {
    let (farm, data) = (Farm::new(1), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    runtime.block_on(async {
        let coordinator = Thief::new(&farm.url, &farm.of("coordinator")).await;
        let thief = Thief::new(&farm.url, &farm.of("workers/worker-1")).await;
        let subject = format!("raystream.live.{}", thief.key);
        let mut asked = thief.client.subscribe(subject.clone()).await.expect("its own subject");
        thief.client.flush().await.expect("it is sent");
        let question = async {
            // The server may know of the thief a little later.
            let began = Instant::now();
            loop {
                let request = Request::new().payload("tile".into()).timeout(Some(Duration::from_millis(500)));
                match coordinator.client.send_request(subject.clone(), request).await {
                    Ok(answer) => return answer,
                    Err(error) => assert!(began.elapsed() < Duration::from_secs(10), "no answer: {error}"),
                }
            }
        };
        let answer = async {
            let message = asked.next().await.expect("a question");
            let to = message.reply.expect("where the answer goes").to_string();
            // An answer to the answer would do harm in the coordinator's account. The subject means nothing here.
            thief.publish(&to, "raystream.ask.join.x", "answer").await;
            thief.client.flush().await.expect("it is sent");
            to
        };
        let (answered, to) = tokio::join!(question, answer);
        assert_eq!(answered.payload, "answer");
        thief.may_not_publish(&to).await;
    });
    drop(service);
}

#[test]
fn a_worker_of_another_version_is_refused_by_name() {
    let (farm, data) = (Farm::new(1), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    let thief = runtime.block_on(Thief::new(&farm.url, &farm.of("workers/worker-1")));
    let join = |build: &Value| -> Value {
        let card = json!({
            "worker": "stranger", "host": "h", "build": build, "session": 1, "slots": 1, "units": "CPU",
            "is_live": false,
        });
        let asked = question(&json!({ "Join": card }));
        let subject = format!("raystream.ask.join.{}", thief.key);
        let answer = runtime.block_on(thief.client.request(subject, asked.into()));
        serde_json::from_slice(&answer.expect("an answer").payload[4..]).expect("JSON")
    };
    let own = serde_json::to_value(raystream_service::contract::Build::own()).expect("JSON");
    assert!(join(&own)["Answer"]["Welcome"]["Joined"].is_object());
    for name in ["raystream", "pictures", "films", "fingerprints", "messages"] {
        let mut build = own.clone();
        build[name] = "another".into();
        let told = join(&build)["Answer"]["Welcome"]["Refused"].as_str().expect("a refusal").to_owned();
        assert!(told.contains(&format!("the version of {name} is another there")), "{told}");
    }
    let mut without = own;
    without.as_object_mut().expect("an object").remove("pictures");
    assert!(
        join(&without)["Answer"]["Welcome"]["Refused"].as_str().is_some_and(|told| told.contains("none"))
    );
    drop(service);
}

#[test]
fn a_worker_of_before_keys_is_told_that_it_is_older() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let runtime = Runtime::new().expect("threads");
    let told: Value = runtime.block_on(async {
        let client = async_nats::connect(nats.url()).await.expect("a connection");
        let asked =
            question(&json!({ "Join": { "worker": "old", "host": "h", "slots": 1, "units": "CPU" } }));
        let began = Instant::now();
        loop {
            match client.request("raystream.ask.join", asked.clone().into()).await {
                Ok(answer) => return serde_json::from_slice(&answer.payload[4..]).expect("JSON"),
                Err(error) => assert!(began.elapsed() < Duration::from_secs(10), "no answer: {error}"),
            }
        }
    });
    let told = told["Answer"]["Welcome"]["Refused"].as_str().expect("a refusal").to_owned();
    assert!(told.contains("is newer than this one"), "{told}");
    drop(service);
}
