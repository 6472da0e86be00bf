//! Workers behind links of their own, in network namespaces, and links that are cut. Linux lets root alone make them.

use crate::machines::Worker;
use crate::relay::Relay;
use crate::service::PATIENCE;
use crate::{Nats, coordinator, folder, rendered, shipped};
use serde_json::json;
use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The time for which a link is down.
pub const CUT: Duration = Duration::from_secs(10);

/// Network namespaces, each joined by a link to a bridge of this machine.
pub struct Links {
    name: String,
    net: u8,
    count: usize,
}

fn ip(command: &str) -> Result<(), String> {
    let output = Command::new("ip").args(command.split(' ')).output().map_err(|error| error.to_string())?;
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(()) } else { Err(format!("ip {command}: {}", told.trim())) }
}

impl Links {
    /// So many; `None` where they cannot be made, which a line says.
    pub fn try_new(count: usize) -> Option<Self> {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let number = MADE.fetch_add(1, Relaxed);
        let id = std::process::id();
        // Names of devices have 15 letters at most, and other processes have other nets.
        let own = Self { name: format!("rt{id}-{number}"), net: ((7 * id + number) % 250) as u8, count };
        match own.make() {
            Ok(()) => Some(own),
            Err(why) => {
                println!("no link is cut, because network namespaces cannot be made here: {why}");
                None
            }
        }
    }

    fn make(&self) -> Result<(), String> {
        let Self { name, net, count } = self;
        ip(&format!("link add {name} type bridge"))?;
        ip(&format!("address add 10.79.{net}.1/24 dev {name}"))?;
        ip(&format!("link set {name} up"))?;
        for place in 0..*count {
            let (space, port, host) = (self.space(place), format!("{name}p{place}"), place + 2);
            ip(&format!("netns add {space}"))?;
            ip(&format!("link add {port} type veth peer name eth0 netns {space}"))?;
            ip(&format!("link set {port} master {name}"))?;
            ip(&format!("link set {port} up"))?;
            ip(&format!("-n {space} address add 10.79.{net}.{host}/24 dev eth0"))?;
            ip(&format!("-n {space} link set eth0 up"))?;
        }
        Ok(())
    }

    /// This machine's address on the bridge.
    pub fn address(&self) -> Ipv4Addr {
        Ipv4Addr::new(10, 79, self.net, 1)
    }

    /// The name of a namespace.
    pub fn space(&self, place: usize) -> String {
        format!("{}-{place}", self.name)
    }

    /// Cuts a link for a while.
    pub fn cut(&self, place: usize, time: Duration) {
        let set = |state: &str| ip(&format!("-n {} link set eth0 {state}", self.space(place)));
        set("down").expect("the link is there");
        std::thread::sleep(time);
        set("up").expect("the link is there");
    }
}

impl Drop for Links {
    fn drop(&mut self) {
        // Some of it may not have been made. A link goes with its namespace.
        for place in 0..self.count {
            let _ = ip(&format!("netns del {}", self.space(place)));
        }
        let _ = ip(&format!("link del {}", self.name));
    }
}

#[test]
fn links_that_are_cut_for_ten_seconds_cost_time_alone() {
    let Some(links) = Links::try_new(2) else { return };
    let (nats, data) = (Nats::start(), folder());
    let relay = Relay::plain(links.address(), nats.port());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let hash = rendered(&shipped("cornell.json"), &["--size", "96x64", "--spp", "512", "--seed", "3"]);
    let worker = |place: usize| {
        Worker::behind(&links, place, folder(), &relay.url(), &format!("w{place}"), &["--insecure"])
    };
    let _workers = [worker(0), worker(1)];
    let id = service.submit(&scene, &json!({ "size": "96x64", "spp": 512, "seed": 3 }));
    let done = || service.job(&id)["units_done"].as_u64().expect("a number");
    let wait_for = |units: u64| {
        let began = Instant::now();
        while done() < units {
            assert!(began.elapsed() < PATIENCE, "{} units are done, {units} are waited for", done());
            std::thread::sleep(Duration::from_millis(20));
        }
        began.elapsed()
    };
    wait_for(3);
    // Both: nothing happens but what was on its way, until they are back.
    let before = done();
    std::thread::scope(|scope| {
        scope.spawn(|| links.cut(0, CUT));
        links.cut(1, CUT);
    });
    let meanwhile = done() - before;
    assert!(meanwhile < 20, "{meanwhile} units over links that are cut");
    let back = wait_for(before + meanwhile + 1);
    println!("the first unit comes {:.1} s after both links are back", back.as_secs_f64());
    assert!(back < CUT, "{back:?}");
    // One of two: the other worker goes on.
    let before = done();
    links.cut(0, CUT);
    assert!(done() > before + 10, "{} units by the other worker", done() - before);
    assert_eq!(service.hashes(&id), [hash]);
}
