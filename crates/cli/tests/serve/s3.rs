//! Results and scenes on S3: a real server checks signatures, expiry and sizes.

use crate::service::{Answer, PATIENCE, Service, folder, raystream, rendered, shipped};
use crate::tls::authority;
use crate::tokens::{add, send};
use hyper_util::rt::{TokioExecutor, TokioIo};
use s3s::auth::SimpleAuth;
use s3s::service::S3ServiceBuilder;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use ureq::Agent;
use ureq::http::{Request, Response};

pub const KEY: &str = "a-key";
pub const SECRET: &str = "a-secret";

/// A server of S3 with one bucket, which lies in a folder.
pub struct Server {
    folder: TempDir,
    pub address: SocketAddr,
    runtime: Option<Runtime>,
    /// Its certificate and key, if it speaks TLS.
    tls: Option<TlsAcceptor>,
}

impl Server {
    pub fn start() -> Self {
        Self::start_with(None)
    }

    fn start_with(tls: Option<TlsAcceptor>) -> Self {
        let folder = folder();
        std::fs::create_dir(folder.path().join("bucket")).expect("a bucket");
        let mut server = Self { folder, address: ([127, 0, 0, 1], 0).into(), runtime: None, tls };
        server.listen();
        server
    }

    /// Listens where it did before.
    fn listen(&mut self) {
        let mut builder =
            S3ServiceBuilder::new(s3s_fs::FileSystem::new(self.folder.path()).expect("a folder"));
        builder.set_auth(SimpleAuth::from_single(KEY, SECRET));
        let (service, runtime) = (builder.build(), Runtime::new().expect("threads"));
        let listener = runtime.block_on(TcpListener::bind(self.address)).expect("a free address");
        self.address = listener.local_addr().expect("an address");
        let tls = self.tls.clone();
        runtime.spawn(async move {
            while let Ok((socket, _)) = listener.accept().await {
                let (tls, service) = (tls.clone(), service.clone());
                tokio::spawn(async move {
                    let http = hyper_util::server::conn::auto::Builder::new(TokioExecutor::new());
                    // Its client may have gone, or trust it not.
                    let _ = match tls {
                        None => http.serve_connection(TokioIo::new(socket), service).await,
                        Some(tls) => {
                            let Ok(socket) = tls.accept(socket).await else { return };
                            http.serve_connection(TokioIo::new(socket), service).await
                        }
                    };
                });
            }
        });
        self.runtime = Some(runtime);
    }

    /// Ends all connections.
    fn stop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_timeout(Duration::from_secs(5));
        }
    }

    /// The file of an object.
    pub fn object(&self, name: &str) -> PathBuf {
        self.folder.path().join("bucket/farm").join(name)
    }

    /// The names of objects below a folder.
    pub fn objects(&self, name: &str) -> Vec<String> {
        fn collect(root: &Path, folder: &Path, names: &mut Vec<String>) {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                let path = entry.path();
                if path.is_dir() {
                    collect(root, &path, names);
                } else {
                    names.push(path.strip_prefix(root).expect("below").to_str().expect("UTF-8").to_owned());
                }
            }
        }
        let mut names = Vec::new();
        collect(&self.object(""), &self.object(name), &mut names);
        names.sort();
        names
    }

    fn options<'a>(&self, endpoint: &'a mut String, more: &[&'a str]) -> Vec<&'a str> {
        *endpoint = format!("http://{}", self.address);
        [&["--storage", "s3://bucket/farm", "--storage-endpoint", endpoint], more].concat()
    }

    fn try_service(&self, data: &Path, more: &[&str], secret: &str) -> Option<Service> {
        let mut endpoint = String::new();
        let variables =
            [("AWS_ACCESS_KEY_ID", KEY), ("AWS_SECRET_ACCESS_KEY", secret), ("AWS_REGION", "us-east-1")];
        Service::launch(&["serve"], data, &self.options(&mut endpoint, more), (None, None), &variables)
    }

    fn service(&self, data: &Path, more: &[&str]) -> Service {
        self.try_service(data, more, SECRET).expect("the service listens")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
    }
}

pub fn small(seed: u32) -> Value {
    json!({ "size": "16x12", "spp": 2, "seed": seed })
}

pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

pub fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Sends a request to the storage, without any token. Redirects are not followed.
fn plain(method: &str, url: &str, token: Option<&str>, body: &[u8]) -> Answer {
    plain_with(method, url, token, None, body)
}

/// The same with the sum of what is written.
fn plain_with(method: &str, url: &str, token: Option<&str>, sum: Option<&str>, body: &[u8]) -> Answer {
    let config =
        Agent::config_builder().http_status_as_error(false).max_redirects(0).max_redirects_will_error(false);
    let mut request = Request::builder().method(method).uri(url);
    if let Some(token) = token {
        request = request.header("Authorization", format!("Bearer {token}"));
    }
    if let Some(sum) = sum {
        request = request.header("x-amz-checksum-sha256", sum);
    }
    let agent = config.build().new_agent();
    let answer = if body.is_empty() {
        agent.run(request.body(()).expect("a request"))
    } else {
        agent.run(request.body(body).expect("a request"))
    };
    let mut answer: Response<ureq::Body> = answer.expect("an answer");
    let text = |value: &ureq::http::HeaderValue| value.to_str().unwrap_or_default().to_owned();
    let headers = answer.headers().iter().map(|(name, value)| (name.to_string(), text(value))).collect();
    let status = answer.status().as_u16();
    Answer { status, headers, body: answer.body_mut().read_to_vec().expect("a body") }
}

pub fn detail(answer: &Answer) -> String {
    answer.json()["detail"].as_str().expect("a detail").to_owned()
}

/// The files below a folder of the data folder.
pub fn copies(data: &Path, kind: &str) -> usize {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
    };
    let count = |folder: PathBuf| if kind == "scenes" { 1 } else { entries(&folder.join("frame-0")).len() };
    entries(&data.join(kind)).into_iter().map(count).sum()
}

#[test]
fn pictures_and_scenes_lie_in_the_bucket_and_come_back_with_their_bytes() {
    let (server, data) = (Server::start(), folder());
    let service = server.service(data.path(), &[]);
    let cornell = shipped("cornell.json");
    let scene = service.upload_file(&cornell);
    let id = service.submit(&scene, &small(1));
    let options = ["--size", "16x12", "--spp", "2", "--seed", "1"];
    assert_eq!(service.hashes(&id), [rendered(&cornell, &options)]);
    let path = format!("/api/v1/jobs/{id}/frames/0");
    let files = ["png", "exr", "npz"].map(|extension| service.get(&format!("{path}.{extension}")).body);
    for (extension, bytes) in ["png", "exr", "npz"].iter().zip(&files) {
        let object = server.object(&format!("jobs/{id}/frame-0/picture.{extension}"));
        assert_eq!(&std::fs::read(object).expect("an object"), bytes, "{extension}");
    }
    let kept = std::fs::read(server.object(&format!("scenes/{scene}"))).expect("an object");
    assert_eq!(sha256(&kept), scene);
    service.kill();

    // Another process without a copy: it reads what the bucket has.
    let service = server.service(data.path(), &["--storage-cache", "1", "--storage-rest", "1s"]);
    wait_until("copies go", || copies(data.path(), "jobs") == 0 && copies(data.path(), "scenes") == 0);
    for (extension, bytes) in ["png", "exr", "npz"].iter().zip(&files) {
        assert_eq!(&service.get(&format!("{path}.{extension}")).body, bytes, "{extension}");
    }
    assert_eq!(service.submit(&scene, &small(1)), id, "its answer is known");
    wait_until("copies go again", || copies(data.path(), "jobs") == 0 && copies(data.path(), "scenes") == 0);
    let again = service.submit(&scene, &small(2));
    let options = ["--size", "16x12", "--spp", "2", "--seed", "2"];
    assert_eq!(service.hashes(&again), [rendered(&cornell, &options)], "its scene came back");

    // Damaged objects: by another byte, by the size, and gone.
    wait_until("copies go", || copies(data.path(), "jobs") == 0 && copies(data.path(), "scenes") == 0);
    let object = |extension: &str| server.object(&format!("jobs/{id}/frame-0/picture.{extension}"));
    let mut bytes = files[0].clone();
    bytes[40] ^= 1;
    std::fs::write(object("png"), &bytes).expect("a file");
    std::fs::write(object("exr"), &files[1][..99]).expect("a file");
    std::fs::remove_file(object("npz")).expect("it was there");
    for (file, told) in [
        ("0.png", "other bytes"),
        ("0.exr", "other bytes"),
        ("0.npz", "no object"),
        ("0/image.npy", "no object"),
    ] {
        let answer = service.get(&format!("/api/v1/jobs/{id}/frames/{file}"));
        assert_eq!(answer.status, 502, "{file}: {} bytes", answer.body.len());
        assert!(
            detail(&answer).contains(told) && detail(&answer).contains("no-cache"),
            "{}",
            detail(&answer)
        );
    }
    let object = server.object(&format!("scenes/{scene}"));
    std::fs::write(&object, kept.to_ascii_uppercase()).expect("a file");
    let refused = service.post("/api/v1/jobs", &json!({ "scene": scene, "size": "8x8", "spp": 1 }));
    assert!(refused.status == 502 && detail(&refused).contains("other bytes"), "{}", refused.json());
    std::fs::write(&object, &kept).expect("a file");
    assert_eq!(service.get("/readyz").status, 200, "it can be used");

    // Deleted jobs take their objects with them.
    for job in [&id, &again] {
        assert_eq!(service.send("DELETE", &format!("/api/v1/jobs/{job}"), &[], Vec::new()).status, 204);
    }
    wait_until("objects go", || server.objects("jobs").is_empty());
    assert_eq!(server.objects("scenes").len(), 1, "the scene rests for an hour");
}

#[test]
fn objects_of_several_requests_come_back_whole() {
    let (server, data) = (Server::start(), folder());
    let service = server.service(data.path(), &[]);
    let mut scene = std::fs::read(shipped("cornell.json")).expect("a scene");
    let right = rendered(&shipped("cornell.json"), &["--size", "16x12", "--spp", "2", "--seed", "1"]);
    // Two whole requests and a part of one.
    scene.resize((16 << 20) + 5, b' ');
    let id = sha256(&scene);
    assert_eq!(service.upload(&scene).1.status, 201);
    let object = server.object(&format!("scenes/{id}"));
    assert!(std::fs::read(&object).expect("an object") == scene);
    service.kill();
    let service = server.service(data.path(), &["--storage-cache", "1", "--storage-rest", "1s"]);
    wait_until("its copy goes", || copies(data.path(), "scenes") == 0);
    let job = service.submit(&id, &small(1));
    assert_eq!(service.hashes(&job), [right]);
    wait_until("its copy goes again", || copies(data.path(), "scenes") == 0);
    // A byte of the last request is another.
    *scene.last_mut().expect("bytes") = b'\n';
    std::fs::write(&object, &scene).expect("a file");
    let refused = service.post("/api/v1/jobs", &json!({ "scene": id, "size": "8x8", "spp": 1 }));
    assert!(refused.status == 502 && detail(&refused).contains("other bytes"), "{}", refused.json());
}

#[test]
fn without_the_storage_nothing_is_lost_and_everyone_is_told() {
    let (mut server, data) = (Server::start(), folder());
    let service = server.service(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let done = service.submit(&scene, &small(1));
    let hashes = service.hashes(&done);
    server.stop();
    let id = service.submit(&scene, &small(2));
    wait_until("it is told", || service.get("/readyz").status == 503);
    let told = detail(&service.get("/readyz"));
    assert!(told.contains("s3://bucket/farm") && told.contains("cannot be used"), "{told}");
    let (_, refused) = service.upload(b"{ \"shapes\": [] }");
    assert_eq!(refused.status, 503, "{}", refused.json());
    assert!(detail(&refused).contains("the storage"), "{}", detail(&refused));
    assert_eq!(service.get(&format!("/api/v1/jobs/{done}/frames/0.png")).status, 200, "there is a copy");
    assert_eq!(service.send("DELETE", &format!("/api/v1/jobs/{done}"), &[], Vec::new()).status, 204);
    let state = service.wait_for(&id, &["running", "done", "failed"]);
    assert_eq!(state["state"], "running", "{state}");
    // A service that starts now waits as well.
    service.kill();
    let service = server.service(data.path(), &[]);
    assert_eq!(service.get("/readyz").status, 503);
    assert!(!server.objects(&format!("jobs/{done}")).is_empty());
    server.listen();
    assert_eq!(service.hashes(&id).len(), 1);
    wait_until("it is ready", || service.get("/readyz").status == 200);
    wait_until("what was deleted goes", || server.objects(&format!("jobs/{done}")).is_empty());
    let again = service.submit(&scene, &small(1));
    assert!(again != done && service.hashes(&again) == hashes);
}

#[test]
fn addresses_of_pictures_are_given_to_their_own_and_end() {
    let (server, data) = (Server::start(), folder());
    let service = server.service(data.path(), &["--storage-expiry", "2s"]);
    let [ann, bob] = [&["ann"][..], &["bob"]].map(|arguments| add(data.path(), arguments));
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &small(1));
    service.hashes(&id);
    let path = format!("/api/v1/jobs/{id}/frames/0");
    for extension in ["png", "exr", "npz"] {
        let bytes = service.get(&format!("{path}.{extension}")).body;
        let ask = format!("{}{path}.{extension}?redirect=true", service.url);
        let answer = plain("GET", &ask, Some(&service.token), b"");
        assert_eq!(answer.status, 307);
        let (about, url) = (answer.json(), answer.header("location"));
        assert_eq!((about["sha256"].as_str(), about["url"].as_str()), (Some(&*sha256(&bytes)), Some(url)));
        assert_eq!(about["bytes"], bytes.len());
        let file = plain("GET", url, None, b"");
        assert!(file.status == 200 && file.body == bytes, "{extension}: {}", file.status);
        // It is an address of this file alone, for reading.
        for (method, url) in [
            ("GET", url.replace("picture", "other")),
            (
                "GET",
                url.replace(&format!("jobs/{id}/frame-0/picture.{extension}"), &format!("scenes/{scene}")),
            ),
            ("DELETE", url.to_owned()),
            ("GET", format!("{}{}", &url[..url.len() - 1], if url.ends_with('0') { 1 } else { 0 })),
        ] {
            assert_eq!(plain(method, &url, None, b"").status, 403, "{method} {url}");
        }
        std::thread::sleep(Duration::from_millis(3100));
        let late = plain("GET", url, None, b"");
        assert!(
            late.status == 403 && String::from_utf8_lossy(&late.body).contains("expired"),
            "{}",
            late.status
        );
        for stranger in [&ann, &bob] {
            let answer = plain("GET", &ask, Some(stranger), b"");
            assert_eq!((answer.status, answer.header("location")), (404, ""));
            assert!(!String::from_utf8_lossy(&answer.body).contains("X-Amz"));
        }
    }
    // Pictures that are made for the caller come as usual.
    for file in ["0.npy?redirect=true", "0.png?redirect=true&view=standard", "0.png?redirect=false"] {
        let answer = service.get(&format!("/api/v1/jobs/{id}/frames/{file}"));
        assert_eq!(answer.status, 200, "{file}: {}", String::from_utf8_lossy(&answer.body));
    }
    assert_eq!(service.get(&format!("{path}.png?redirect=perhaps")).status, 400);
}

#[test]
fn scenes_are_written_to_addresses_and_taken_in_when_they_are_right() {
    let (server, data) = (Server::start(), folder());
    let service = server.service(data.path(), &["--max-upload", "1M"]);
    let [ann, bob] = [&["ann"][..], &["bob"]].map(|arguments| add(data.path(), arguments));
    let scene = std::fs::read(shipped("cornell.json")).expect("a scene");
    let ask = |token: &str, bytes: &[u8], verb: &str| {
        let path = format!("/api/v1/scenes/{}/{verb}", sha256(bytes));
        send(&service, token, "POST", &path, Some(&json!({ "bytes": bytes.len() })))
    };
    let early = ask(&ann, &scene, "take");
    assert!(early.status == 409 && detail(&early).contains("PUT"), "{}", early.json());
    let address = ask(&ann, &scene, "address").json();
    let url = address["url"].as_str().expect("an address");
    assert_eq!((&address["method"], &address["expires_s"]), (&json!("PUT"), &json!(900)));
    let sum = address["headers"]["x-amz-checksum-sha256"].as_str().expect("a sum");
    assert_eq!(plain("PUT", url, None, &scene).status, 403, "without its sum");
    assert_eq!(plain("GET", url, None, b"").status, 403, "it is for writing");
    let other: Vec<u8> = scene.iter().map(u8::to_ascii_uppercase).collect();
    assert_eq!(plain_with("PUT", url, None, Some(sum), &other).status, 400, "the sum is another");
    // A storage may keep what it has refused.
    let status = ask(&ann, &scene, "take").status;
    assert!([409, 422].contains(&status), "nothing right was written: {status}");
    let write = || assert_eq!(plain_with("PUT", url, None, Some(sum), &scene).status, 200);
    write();
    // A storage that changes what it was given.
    let written = server.objects("uploads");
    std::fs::write(server.object(&written[0]), &other).expect("a file");
    let refused = ask(&ann, &scene, "take");
    assert!(refused.status == 422 && detail(&refused).contains("SHA-256"), "{}", refused.json());
    assert_eq!(ask(&ann, &scene, "take").status, 409, "it is not kept");
    write();
    assert_eq!(ask(&bob, &scene, "take").status, 409, "it is another's");
    let taken = ask(&ann, &scene, "take");
    assert_eq!((taken.status, &taken.json()["sha256"]), (201, &json!(sha256(&scene))));
    assert_eq!(ask(&ann, &scene, "take").status, 200, "it is there");
    let about = format!("/api/v1/scenes/{}", sha256(&scene));
    assert_eq!(send(&service, &ann, "GET", &about, None).status, 200);
    assert_eq!(send(&service, &bob, "GET", &about, None).status, 404);
    assert_eq!((server.objects("uploads"), server.objects("scenes").len()), (vec![], 1));
    let job = json!({ "scene": sha256(&scene), "size": "8x8", "spp": 1 });
    let id = send(&service, &ann, "POST", "/api/v1/jobs", Some(&job)).json()["id"].clone();
    assert_eq!(service.hashes(id.as_str().expect("a job")).len(), 1);

    // What an upload may not be, this may not be.
    let noise = b"MZ no scene".to_vec();
    let address = ask(&ann, &noise, "address").json();
    let (url, sum) = (address["url"].as_str(), address["headers"]["x-amz-checksum-sha256"].as_str());
    assert_eq!(plain_with("PUT", url.expect("an address"), None, sum, &noise).status, 200);
    assert_eq!(ask(&ann, &noise, "take").status, 415);
    assert_eq!(ask(&ann, &vec![b'{'; (1 << 20) + 1], "address").status, 413);
    assert_eq!(ask(&ann, b"", "address").status, 422);
    assert_eq!(
        send(&service, &ann, "POST", "/api/v1/scenes/x/address", Some(&json!({ "bytes": 1 }))).status,
        404
    );
    assert_eq!((server.objects("uploads"), server.objects("scenes").len()), (vec![], 1));
}

#[test]
fn kills_between_bucket_and_ledger_lose_nothing_and_leave_nothing() {
    let (server, data) = (Server::start(), folder());
    let mut service = server.service(data.path(), &["--failpoint", "scene-stored"]);
    let path = format!("/api/v1/scenes/{}", sha256(b"{ \"shapes\": [] }"));
    assert!(service.try_send("PUT", &path, &[], b"{ \"shapes\": [] }".to_vec()).is_none());
    service.wait_for_end();
    assert_eq!(server.objects("scenes").len(), 1, "an object that the ledger does not know");
    let mut service = server.service(data.path(), &["--failpoint", "pictures-stored"]);
    wait_until("it goes", || server.objects("scenes").is_empty());
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &small(1));
    service.wait_for_end();
    assert_eq!(server.objects("jobs").len(), 3, "pictures that the ledger does not know");
    let mut service = server.service(data.path(), &["--failpoint", "objects-deleted"]);
    let hashes = service.hashes(&id);
    let png = service.get(&format!("/api/v1/jobs/{id}/frames/0.png")).body;
    assert_eq!(std::fs::read(server.object(&format!("jobs/{id}/frame-0/picture.png"))).expect("one"), png);
    assert_eq!(service.send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new()).status, 204);
    service.wait_for_end();
    assert_eq!(copies(data.path(), "jobs"), 3, "its copies are still there");
    // An object of a job that no ledger knows.
    std::fs::create_dir_all(server.object("jobs/0123456789abcdef/frame-0")).expect("a folder");
    std::fs::write(server.object("jobs/0123456789abcdef/frame-0/picture.png"), b"x").expect("a file");
    let service = server.service(data.path(), &[]);
    wait_until("all goes", || copies(data.path(), "jobs") == 0 && server.objects("jobs").is_empty());
    let again = service.submit(&scene, &small(1));
    assert!(again != id && service.hashes(&again) == hashes);
}

#[test]
fn a_storage_belongs_to_one_data_folder() {
    let (server, data, other) = (Server::start(), folder(), folder());
    let service = server.service(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &small(1));
    service.hashes(&id);
    service.kill();
    assert!(server.try_service(other.path(), &[], SECRET).is_none(), "another's bucket");
    assert!(Service::try_start(data.path(), &[]).is_none(), "its results lie elsewhere");
    let moved = server.folder.path().join("bucket/moved");
    std::fs::rename(server.object(""), &moved).expect("renamed");
    assert!(server.try_service(data.path(), &[], SECRET).is_none(), "an empty place");
    std::fs::rename(&moved, server.object("")).expect("renamed");
    // With a wrong key it starts, says so, and works once the key is right.
    let service = server.try_service(data.path(), &[], "another").expect("it listens");
    let told = service.get("/readyz");
    assert!(told.status == 503 && detail(&told).contains("s3://bucket/farm"), "{}", told.json());
    service.kill();
    let service = server.service(data.path(), &[]);
    assert_eq!((service.get("/readyz").status, service.hashes(&id).len()), (200, 1));
    for (arguments, told) in [
        (&["--storage", "bucket"][..], "s3://BUCKET"),
        (&["--storage", "s3://b", "--storage-endpoint", "http://minio.example"], "not encrypted"),
        (&["--storage", "s3://b", "--storage-expiry", "8d"], "7d"),
        (&["--storage-endpoint", "http://localhost"], "--storage"),
    ] {
        let folder = folder();
        let data = folder.path().to_str().expect("UTF-8");
        let output = raystream(&[&["serve", "--data", data, "--listen", "127.0.0.1:0"], arguments].concat());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && errors.contains(told), "{arguments:?}: {errors}");
    }
}

/// What makes a server speak TLS with a certificate.
fn acceptor(certificate: &str, key: &str) -> TlsAcceptor {
    let _ = tokio_rustls::rustls::crypto::ring::default_provider().install_default();
    let chain = vec![CertificateDer::from_pem_file(certificate).expect("a certificate")];
    let key = PrivateKeyDer::from_pem_file(key).expect("a key");
    let config = ServerConfig::builder().with_no_client_auth().with_single_cert(chain, key);
    TlsAcceptor::from(std::sync::Arc::new(config.expect("they belong together")))
}

#[test]
fn a_storage_over_tls_is_known_by_a_file_of_authorities_or_the_systems() {
    let (keys, others, data) = (folder(), folder(), folder());
    let ([ca, certificate, key], [other, ..]) = (authority(keys.path()), authority(others.path()));
    let server = Server::start_with(Some(acceptor(&certificate, &key)));
    let endpoint = format!("https://localhost:{}", server.address.port());
    let start = |trust: &[&str], system: &str| {
        let options = [&["--storage", "s3://bucket/farm", "--storage-endpoint", &endpoint], trust].concat();
        let variables = [
            ("AWS_ACCESS_KEY_ID", KEY),
            ("AWS_SECRET_ACCESS_KEY", SECRET),
            ("AWS_REGION", "us-east-1"),
            ("SSL_CERT_FILE", system),
            ("SSL_CERT_DIR", ""),
        ];
        Service::launch(&["serve"], data.path(), &options, (None, None), &variables)
    };
    // Neither by the system's, nor by another authority in its place.
    for (trust, system) in [(&[][..], &other), (&["--ca", &other], &ca)] {
        let service = start(trust, system).expect("it listens");
        let told = service.get("/readyz");
        assert!(told.status == 503 && detail(&told).contains("invalid peer certificate"), "{}", told.json());
        assert!(detail(&told).contains("--ca"), "{}", detail(&told));
        let (_, refused) = service.upload(b"{ \"shapes\": [] }");
        let why = detail(&refused);
        assert!(refused.status == 503 && why.contains("invalid peer certificate"), "{why}");
        assert_eq!(why.matches("cannot be used").count(), 1, "{why}");
        service.kill();
    }
    assert!(start(&["--ca", &key], &ca).is_none(), "a file without certificates");
    for (trust, system, seed) in [(&["--ca", &ca][..], &other, 1), (&[], &ca, 2)] {
        let service = start(trust, system).expect("it listens");
        assert_eq!(service.get("/readyz").status, 200);
        let scene = service.upload_file(&shipped("cornell.json"));
        let id = service.submit(&scene, &small(seed));
        assert_eq!(service.hashes(&id).len(), 1);
        let png = service.get(&format!("/api/v1/jobs/{id}/frames/0.png")).body;
        assert_eq!(
            std::fs::read(server.object(&format!("jobs/{id}/frame-0/picture.png"))).expect("one"),
            png
        );
        service.kill();
    }
}
