//! The promises of a bus, kept over a real server, which must be installed (Debian: `apt install nats-server`).

use super::{NatsBus, NatsOptions, NatsServer};
use crate::bus::{WorkBus, promises};
use std::sync::Arc;

#[test]
fn the_promises_hold() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = NatsServer::start(folder.path(), "test").expect("nats-server is installed and starts");
    let bus = |key: std::path::PathBuf| {
        let mut options = NatsOptions::new(server.url());
        options.prefix = "test".into();
        options.nkey = Some(key);
        Arc::new(NatsBus::connect(options, "test").expect("a connection"))
    };
    promises::check(|| {
        let worker = bus(server.worker_keys());
        let key = worker.key().to_owned();
        (bus(server.key()) as Arc<dyn WorkBus>, worker as Arc<dyn WorkBus>, key)
    });
}
