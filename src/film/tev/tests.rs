//! A viewer that comes late, sees what has changed, and leaves.

use super::Tev;
use crate::film::{Image, Picture};
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

/// A picture of 200 × 130 pixels: two tiles in a row, two rows.
fn picture(bright: usize) -> Picture {
    let mut pixels = vec![[0.25, 0.5, f32::INFINITY]; 200 * 130];
    pixels[bright] = [1.0, 2.0, 3.0];
    Picture::new(Image::new(200, 130, pixels))
}

/// The operation and the fields of a packet.
fn packet(connection: &mut TcpStream) -> (u8, Vec<u8>) {
    let mut length = [0; 4];
    connection.read_exact(&mut length).expect("a length");
    let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
    connection.read_exact(&mut rest).expect("a packet");
    (rest[0], rest[1..].to_vec())
}

fn number(fields: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(fields[at..at + 4].try_into().expect("four bytes"))
}

/// Left, top, width and height of an update.
fn tile((operation, fields): (u8, Vec<u8>)) -> [u32; 4] {
    assert_eq!((operation, &fields[..6]), (6, &b"\0view\0"[..]));
    assert_eq!((number(&fields, 6), &fields[10..16]), (3, &b"R\0G\0B\0"[..]));
    let tile = [16, 20, 24, 28].map(|at| number(&fields, at));
    assert_eq!(fields.len(), 32 + 6 * 8 + tile[2] as usize * tile[3] as usize * 3 * 4);
    let strides = fields[32..80].as_chunks::<8>().0.iter().map(|&bytes| u64::from_le_bytes(bytes));
    assert_eq!(strides.collect::<Vec<_>>(), [0, 1, 2, 3, 3, 3]);
    tile
}

#[test]
fn changed_tiles_are_sent_to_whoever_listens() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let tev = Tev::new(address.to_string()).expect("a thread");
    tev.show("view", &picture(0));
    let (mut viewer, _) = listener.accept().expect("a connection");
    viewer.set_read_timeout(Some(Duration::from_secs(20))).expect("a time");
    let (operation, fields) = packet(&mut viewer);
    assert_eq!((operation, &fields[..6]), (4, &b"\0view\0"[..]));
    assert_eq!([6, 10, 14].map(|at| number(&fields, at)), [200, 130, 3]);
    assert_eq!(&fields[18..], b"R\0G\0B\0");
    let all = [[0, 0, 128, 128], [128, 0, 72, 128], [0, 128, 128, 2], [128, 128, 72, 2]];
    assert_eq!([(); 4].map(|()| tile(packet(&mut viewer))), all);

    // A bright pixel moves from the first tile to the last one.
    tev.show("view", &picture(129 * 200 + 199));
    assert_eq!([(); 2].map(|()| tile(packet(&mut viewer))), [all[0], all[3]]);

    // A viewer that comes again gets everything again.
    drop(viewer);
    for bright in 1.. {
        tev.show("view", &picture(bright));
        std::thread::sleep(Duration::from_millis(20));
        listener.set_nonblocking(true).expect("a listener");
        if let Ok((mut viewer, _)) = listener.accept() {
            viewer.set_nonblocking(false).expect("a stream");
            viewer.set_read_timeout(Some(Duration::from_secs(20))).expect("a time");
            assert_eq!(packet(&mut viewer).0, 4);
            assert_eq!([(); 4].map(|()| tile(packet(&mut viewer))), all);
            break;
        }
        assert!(bright < 1000, "it connects again");
    }
}

#[test]
fn a_viewer_that_is_not_there_stops_nothing() {
    let address = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let tev = Tev::new(address.expect("an address").to_string()).expect("a thread");
    for bright in 0..50 {
        tev.show("view", &picture(bright));
    }
    drop(tev);
    drop(Tev::new("no address").expect("a thread"));
}
