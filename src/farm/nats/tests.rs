//! The contract with a real server, which must be installed (Debian: `apt install nats-server`).

use super::super::contract;
use super::super::{Backlog, WorkBus};
use super::{NatsBus, NatsOptions, NatsServer};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

fn bus(server: &NatsServer, prefix: &str) -> Arc<NatsBus> {
    let mut options = NatsOptions::new(server.url());
    options.prefix = prefix.into();
    options.lease = contract::LEASE;
    Arc::new(NatsBus::connect(options, "test").expect("a connection"))
}

#[test]
fn the_contract_holds() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = NatsServer::start(folder.path()).expect("nats-server is installed and starts");
    let farms = AtomicU32::new(0);
    contract::check(|| {
        let farm = format!("farm{}", farms.fetch_add(1, Relaxed));
        let ends: [Arc<dyn WorkBus>; 2] = [bus(&server, &farm), bus(&server, &farm)];
        ends[0].backlog().expect("the queue is made");
        ends.into()
    });
}

#[test]
fn a_lost_queue_is_made_again_and_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = NatsServer::start(folder.path()).expect("nats-server is installed and starts");
    let bus = bus(&server, "lost");
    assert_eq!(bus.backlog(), Ok(Backlog { units: 0, is_new: false }));
    let other = NatsBus::connect(NatsOptions::new(server.url()), "vandal").expect("a connection");
    other.delete_queue("LOST_WORK");
    assert_eq!(bus.backlog(), Ok(Backlog { units: 0, is_new: true }));
    assert_eq!(bus.backlog(), Ok(Backlog { units: 0, is_new: false }));
}
