//! A viewer that speaks tev's protocol, and keeps what it is shown.

use std::collections::BTreeMap;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// An image as tev would show it.
#[derive(Debug, Default)]
pub struct Shown {
    pub width: usize,
    pub height: usize,
    /// The values of each channel by name, row after row.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// Tiles that it was sent.
    pub updates: usize,
}

/// Images by name.
pub type Images = BTreeMap<String, Shown>;

/// Listens, and shows what the first connection sends until it ends.
pub fn listen() -> (String, Receiver<Images>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let (send, receive) = channel();
    std::thread::spawn(move || {
        let (connection, _) = listener.accept().expect("a connection");
        // The test may have failed.
        send.send(show(connection)).ok();
    });
    (address, receive)
}

/// Waits until a viewer's client has left, and returns the images that the viewer has been shown.
pub fn wait_for(images: &Receiver<Images>) -> Images {
    images.recv_timeout(Duration::from_secs(120)).expect("a viewer")
}

fn show(mut connection: TcpStream) -> Images {
    let mut images = Images::new();
    let mut length = [0; 4];
    while connection.read_exact(&mut length).is_ok() {
        let mut packet = vec![0; u32::from_le_bytes(length) as usize - 4];
        if connection.read_exact(&mut packet).is_err() {
            // A client that is killed ends anywhere.
            break;
        }
        apply(&mut images, Fields(&packet));
    }
    images
}

/// The fields of a packet that have not been read.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().expect("a field");
        self.0 = rest;
        *bytes
    }

    fn number(&mut self) -> usize {
        i32::from_le_bytes(self.bytes()).try_into().expect("no negative numbers")
    }

    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&byte| byte == 0).expect("a text ends with zero");
        let text = String::from_utf8(self.0[..end].to_vec()).expect("UTF-8");
        self.0 = &self.0[end + 1..];
        text
    }
}

fn apply(images: &mut Images, mut fields: Fields<'_>) {
    let ([operation], [grabs_focus]) = (fields.bytes(), fields.bytes());
    assert_eq!(grabs_focus, 0);
    let name = fields.text();
    match operation {
        4 => {
            let [width, height, count] = [(); 3].map(|()| fields.number());
            let names = (0..count).map(|_| fields.text());
            let channels = names.map(|name| (name, vec![f32::NAN; width * height])).collect();
            images.insert(name, Shown { width, height, channels, updates: 0 });
        }
        6 => {
            let image = images.get_mut(&name).expect("an image that was created");
            image.updates += 1;
            let count = fields.number();
            let names: Vec<String> = (0..count).map(|_| fields.text()).collect();
            let [x, y, width, height] = [(); 4].map(|()| fields.number());
            let mut numbers =
                || (0..count).map(|_| i64::from_le_bytes(fields.bytes()) as usize).collect::<Vec<_>>();
            let (offsets, strides) = (numbers(), numbers());
            let (values, []) = fields.0.as_chunks::<4>() else { panic!("floats") };
            assert_eq!(values.len(), width * height * count, "no more than the tile's values");
            for (channel, name) in names.iter().enumerate() {
                let kept = image.channels.get_mut(name).expect("a channel that was created");
                for pixel in 0..width * height {
                    let at = (y + pixel / width) * image.width + x + pixel % width;
                    kept[at] = f32::from_le_bytes(values[offsets[channel] + pixel * strides[channel]]);
                }
            }
        }
        other => panic!("operation {other}"),
    }
}
