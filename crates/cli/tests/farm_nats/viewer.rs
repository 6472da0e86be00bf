//! A client of a live view: a WebSocket, and no more of it than a test needs.

use crate::service::{PATIENCE, Service};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Bytes of the header of a frame.
const HEADER: usize = 32;

/// A moving frame or one of the full picture.
pub struct Frame {
    pub generation: u64,
    pub is_moving: bool,
    /// True if coarse rows stand in for those of a worker that was late.
    pub is_coarse: bool,
    pub size: [u16; 2],
    pub jpeg: Vec<u8>,
}

impl Frame {
    pub fn pixels(&self) -> image::RgbImage {
        image::load_from_memory(&self.jpeg).expect("a JPEG").into_rgb8()
    }

    /// True if its JPEG defines a restart interval: several machines have made it.
    pub fn is_shared(&self) -> bool {
        self.jpeg.windows(2).any(|pair| pair == [0xff, 0xdd])
    }
}

pub struct Viewer {
    stream: TcpStream,
    generation: u64,
    /// The workers in the last statistics.
    pub workers: Vec<Value>,
}

impl Viewer {
    /// Opens a view of a scene, or of the service's own, in this size, with a fixed exposure.
    pub fn open(service: &Service, scene: Option<&str>, size: [u32; 2]) -> Self {
        let query = scene.map_or(String::new(), |scene| format!("?scene={scene}"));
        let host = service.url.strip_prefix("http://").expect("an address");
        let mut stream = TcpStream::connect(host).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
        stream.set_nodelay(true).expect("small messages leave at once");
        write!(
            stream,
            "GET /api/v1/live{query} HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
             Authorization: Bearer {}\r\n\r\n",
            service.token
        )
        .expect("a request");
        let mut answer = Vec::new();
        while !answer.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).expect("an answer");
            answer.push(byte[0]);
        }
        assert!(answer.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&answer));
        let mut own = Self { stream, generation: 0, workers: Vec::new() };
        own.send(&json!({ "type": "look", "exposure": 0, "view": "agx" }));
        own.change(json!({ "type": "size", "width": size[0], "height": size[1] }));
        own.change(json!({ "type": "quality", "spp": 1, "max_bounces": 3 }));
        own
    }

    /// Sends a message of a client, which is masked: with zeros, which leave it as it is.
    fn send(&mut self, message: &Value) {
        let text = message.to_string();
        let mut frame = vec![0x81];
        match text.len() {
            length @ ..126 => frame.push(0x80 | length as u8),
            length => {
                frame.push(0x80 | 126);
                frame.extend((length as u16).to_be_bytes());
            }
        }
        frame.extend([0; 4]);
        frame.extend(text.as_bytes());
        self.stream.write_all(&frame).expect("it is sent");
    }

    fn change(&mut self, mut message: Value) -> u64 {
        self.generation += 1;
        message["generation"] = self.generation.into();
        self.send(&message);
        self.generation
    }

    /// Edits a material.
    pub fn edit(&mut self, material: u32, edit: &Value) {
        self.change(json!({ "type": "material", "material": material, "edit": edit }));
    }

    /// Shows the scene at a time in seconds.
    pub fn show_time(&mut self, seconds: f64) {
        self.change(json!({ "type": "time", "seconds": seconds }));
    }

    /// The kind and the content of the next message.
    fn receive(&mut self) -> (u8, Vec<u8>) {
        let mut read = |count: usize| {
            let mut bytes = vec![0; count];
            self.stream.read_exact(&mut bytes).expect("the view goes on");
            bytes
        };
        let start = read(2);
        let number = |bytes: Vec<u8>| bytes.iter().fold(0, |number, &byte| number << 8 | usize::from(byte));
        let length = match start[1] {
            126 => number(read(2)),
            127 => number(read(8)),
            length => length.into(),
        };
        (start[0] & 0xf, read(length))
    }

    /// The next frame. Statistics on the way to it are kept.
    fn next(&mut self) -> Frame {
        loop {
            match self.receive() {
                (1, text) => {
                    let reply: Value = serde_json::from_slice(&text).expect("JSON");
                    assert_ne!(reply["type"], "refused", "{reply}");
                    if reply["type"] == "statistics" {
                        self.workers = reply["workers"].as_array().expect("workers").clone();
                    }
                }
                (2, bytes) => {
                    let number = |at: usize, count: usize| {
                        bytes[at..at + count]
                            .iter()
                            .rev()
                            .fold(0, |number, &byte| number << 8 | u64::from(byte))
                    };
                    self.send(&json!({ "type": "ack", "sequence": number(12, 4) }));
                    return Frame {
                        generation: number(8, 4),
                        is_moving: bytes[5] & 1 != 0,
                        is_coarse: bytes[5] & 4 != 0,
                        size: [number(20, 2) as u16, number(22, 2) as u16],
                        jpeg: bytes[HEADER..].to_vec(),
                    };
                }
                _ => {}
            }
        }
    }

    /// Looks from somewhere around the middle of the box; returns the moving frame, and how long it took.
    pub fn look(&mut self, angle: f32) -> (Frame, Duration) {
        let eye = [278.0 + 500.0 * angle.sin(), 273.0, 280.0 - 1000.0 * angle.cos()];
        let pose = json!({ "eye": eye, "target": [278, 273, 280], "up": [0, 1, 0], "fov": 40, "lens": null });
        let (began, generation) = (Instant::now(), self.change(json!({ "type": "camera", "pose": pose })));
        loop {
            let frame = self.next();
            if frame.generation == generation && frame.is_moving {
                return (frame, began.elapsed());
            }
        }
    }

    /// Looks from a place until a frame is as it is to be.
    pub fn until(&mut self, angle: f32, what: &str, is_it: impl Fn(&Self, &Frame) -> bool) -> Frame {
        let began = Instant::now();
        loop {
            let (frame, _) = self.look(angle);
            if is_it(self, &frame) {
                return frame;
            }
            assert!(began.elapsed() < PATIENCE, "{what} does not come: {:?}", self.workers);
        }
    }

    /// A number that the statistics have of a worker.
    pub fn of(&self, worker: &str, number: &str) -> u64 {
        let own = self.workers.iter().find(|own| own["name"] == worker);
        own.and_then(|own| own[number].as_u64()).unwrap_or(0)
    }
}
