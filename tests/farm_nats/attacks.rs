//! What a stolen key of a worker can do: nothing but what a worker does.

use crate::secured::Farm;
use crate::{folder, shipped, still};
use async_nats::client::Request;
use async_nats::jetstream::{self, stream::Info};
use async_nats::{Client, ConnectOptions, Event, Subscriber};
use nkeys::KeyPair;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

const STREAM: &str = "RAYSTREAM_WORK";

/// A connection with the key of a process of a farm.
struct Thief {
    client: Client,
    /// What the server has refused.
    refused: Arc<Mutex<Vec<String>>>,
    inbox: String,
    key: String,
}

fn seed(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("nats.key")).expect("a key").trim().to_owned()
}

fn public_key(folder: &Path) -> String {
    KeyPair::from_seed(&seed(folder)).expect("a seed").public_key()
}

impl Thief {
    async fn new(url: &str, folder: &Path) -> Self {
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
        Self { client, refused, inbox, key }
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

    /// Leases a unit; returns the subject of its acknowledgement.
    async fn lease(&self) -> String {
        let next = format!("$JS.API.CONSUMER.MSG.NEXT.{STREAM}.lo");
        let wanted = json!({ "batch": 1, "no_wait": true }).to_string();
        let request = Request::new().payload(wanted.into()).inbox(self.client.new_inbox());
        let leased = self.client.send_request(next, request).await.expect("an answer");
        assert_eq!(leased.status, None, "there is a unit");
        leased.reply.expect("where to acknowledge it").to_string()
    }
}

/// A question of a worker, as bytes.
fn question(ask: &Value) -> Vec<u8> {
    let text = json!({ "ask": ask, "part": null }).to_string();
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

/// The queue, as the coordinator sees it, and its number of units.
async fn queue(client: &Client) -> (Info, u64) {
    let mut stream = jetstream::new(client.clone()).get_stream(STREAM).await.expect("the queue is there");
    let info = stream.info().await.expect("the queue is there").clone();
    (info.clone(), info.state.messages)
}

/// Everything that a worker has no business with, each refused by name.
async fn try_what_is_not_allowed(thief: &Thief, key_of_other: &str) -> Vec<Subscriber> {
    let other = format!("_INBOX.{key_of_other}");
    let api = |what: &str| format!("$JS.API.{what}");
    for subject in [
        "raystream.work.lo.job.0.0.0.0".into(),
        api(&format!("STREAM.DELETE.{STREAM}")),
        api(&format!("STREAM.PURGE.{STREAM}")),
        api(&format!("STREAM.UPDATE.{STREAM}")),
        api(&format!("STREAM.INFO.{STREAM}")),
        api(&format!("STREAM.SNAPSHOT.{STREAM}")),
        api(&format!("STREAM.MSG.GET.{STREAM}")),
        api(&format!("STREAM.MSG.DELETE.{STREAM}")),
        api("STREAM.CREATE.MINE"),
        api(&format!("CONSUMER.DELETE.{STREAM}.lo")),
        api(&format!("CONSUMER.INFO.{STREAM}.lo")),
        api(&format!("CONSUMER.DURABLE.CREATE.{STREAM}.mine")),
        api(&format!("CONSUMER.MSG.NEXT.{STREAM}.mine")),
        api("ACCOUNT.PURGE.COORDINATOR"),
        api("INFO"),
        "$SYS.REQ.SERVER.PING".into(),
        "raystream.ask.anything".into(),
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
        "raystream.ask.*",
        "raystream.ask.result",
        "raystream.work.>",
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
async fn have_others_do_it(thief: &Thief) {
    let leased = thief.lease().await;
    for target in [
        format!("$JS.API.STREAM.DELETE.{STREAM}"),
        format!("$JS.API.STREAM.PURGE.{STREAM}"),
        format!("$JS.API.CONSUMER.DELETE.{STREAM}.lo"),
        "$JS.API.ACCOUNT.PURGE.COORDINATOR".into(),
        "raystream.work.lo.job.0.0.0.9".into(),
    ] {
        for kind in ["join", "report", "start", "files", "file", "result", "failure"] {
            thief.publish(&format!("raystream.ask.{kind}"), &target, "").await;
        }
        let asked = question(&json!({ "Leave": "a worker that is none" }));
        let published = thief.client.publish_with_reply("raystream.ask.leave", target.clone(), asked.into());
        published.await.expect("it is sent");
        // Answered without content, as a deletion is to be asked for.
        thief.publish(&leased, &target, "+WPI").await;
        let none = json!({ "batch": 1, "no_wait": true }).to_string();
        thief.publish(&format!("$JS.API.CONSUMER.MSG.NEXT.{STREAM}.hi"), &target, &none).await;
    }
    thief.publish(&leased, &format!("$JS.API.STREAM.DELETE.{STREAM}"), "+ACK").await;
    let leased = thief.lease().await;
    thief.publish(&leased, "raystream.work.lo.job.0.0.0.8", "+NXT").await;
    thief.client.flush().await.expect("all is sent");
    // Longer than a server and a coordinator take to answer.
    tokio::time::sleep(Duration::from_millis(500)).await;
}

#[test]
fn a_stolen_key_gives_no_work_reads_no_results_and_deletes_nothing() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    let (coordinator, thief, mut listening) = runtime.block_on(async {
        let coordinator = Thief::new(&farm.url, &farm.of("coordinator")).await;
        for number in 0..4 {
            let subject = format!("raystream.work.lo.job.0.0.{number}.0");
            let context = jetstream::new(coordinator.client.clone());
            context
                .publish(subject, "no unit".into())
                .await
                .expect("sent")
                .await
                .expect("it is in the queue");
        }
        let thief = Thief::new(&farm.url, &farm.of("workers/worker-1")).await;
        let other = public_key(&farm.of("workers/worker-2"));
        let listening = try_what_is_not_allowed(&thief, &other).await;
        (coordinator.client, thief, listening)
    });
    let (before, units) = runtime.block_on(queue(&coordinator));
    assert_eq!(units, 4);
    runtime.block_on(have_others_do_it(&thief));
    let (after, units) = runtime.block_on(queue(&coordinator));
    assert_eq!((after.created, after.state.consumer_count), (before.created, 2));
    assert_eq!(units, 2, "the thief has leased two units and ended both, as a worker may");
    assert!(thief.client.server_info().client_id > 0, "{}", thief.inbox);

    // It listens while another worker renders.
    let _worker = farm.worker("worker-2");
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
    for subscriber in &mut listening {
        let heard = runtime.block_on(async {
            tokio::time::timeout(Duration::from_millis(10), futures_util::StreamExt::next(subscriber)).await
        });
        assert!(!matches!(heard, Ok(Some(_))), "{heard:?}");
    }
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
            let message = futures_util::StreamExt::next(&mut asked).await.expect("a question");
            let to = message.reply.expect("where the answer goes").to_string();
            // An answer to the answer would do harm in the coordinator's account. The subject means nothing here.
            thief.publish(&to, &format!("$JS.API.STREAM.DELETE.{STREAM}"), "answer").await;
            thief.client.flush().await.expect("it is sent");
            to
        };
        let (answered, to) = tokio::join!(question, answer);
        assert_eq!(answered.payload, "answer");
        thief.may_not_publish(&to).await;
        let (_, units) = queue(&coordinator.client).await;
        assert_eq!(units, 0, "the queue is there");
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
        let card = json!({ "worker": "stranger", "host": "h", "build": build, "slots": 1, "units": "CPU" });
        let asked = question(&json!({ "Join": card }));
        let answer = runtime.block_on(thief.client.request("raystream.ask.join", asked.into()));
        serde_json::from_slice(&answer.expect("an answer").payload[4..]).expect("JSON")
    };
    let own = serde_json::to_value(raystream::farm::Build::own()).expect("JSON");
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
