//! Parts of a frame, and the files in which they are kept: together they are the whole frame to the bit.

use super::harness::{render, tracer};
use super::scenes::{camera, room};
use crate::film::{Film, Image, Region};
use crate::geom::mix;
use crate::render::{
    Identity, Integrator, PARTIAL_FILM_VERSION, Part, PartialFilm, PartialFilmError, PartialFilmHeader,
    PathTracer, Settings, SettingsError,
};
use std::io::Cursor;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

const SETTINGS: Settings = Settings::new(50, 40).with_spp(6).with_max_bounces(3).with_seed(5);

fn path() -> PathTracer {
    PathTracer::new(Arc::new(room()), &camera(), SETTINGS, Some(3)).expect("settings")
}

fn identity(seed: u64) -> Identity {
    Identity::new([("--seed".to_owned(), seed.to_string())])
}

fn saved(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.save(&mut bytes).expect("memory");
    bytes
}

fn part(region: &str, samples: std::ops::Range<u32>) -> Part {
    Part { region: region.parse().expect("a region"), samples }
}

/// The file of a rendered part.
fn file_of(whole: &PathTracer, part: Part) -> Vec<u8> {
    let rendered = whole.with_part(part).expect("a part");
    render(&rendered, 256, &tracer(rendered.frame().scene()));
    let film = PartialFilm::new(identity(5), rendered.frame(), Arc::clone(rendered.frame().film()));
    let mut bytes = Vec::new();
    let film = film.expect("it is finished").with_metadata([("spp".to_owned(), "6".to_owned())].into());
    film.write(&mut bytes).expect("memory");
    bytes
}

fn read(file: &[u8]) -> Result<PartialFilm, PartialFilmError> {
    PartialFilm::read(Cursor::new(file))
}

/// Divides a part at random places into this many.
fn split(part: Part, count: usize, random: &mut impl FnMut(u32) -> u32) -> Vec<Part> {
    let mut parts = vec![part];
    while parts.len() < count {
        let Part { region, samples } = parts.swap_remove(random(parts.len() as u32) as usize);
        let Region { x, y, width, height } = region;
        let (one, other) = match random(3) {
            0 if width > 1 => {
                let left = 1 + random(width - 1);
                let other = Region { x: x + left, width: width - left, ..region };
                ((Region { width: left, ..region }, samples.clone()), (other, samples))
            }
            1 if height > 1 => {
                let upper = 1 + random(height - 1);
                let other = Region { y: y + upper, height: height - upper, ..region };
                ((Region { height: upper, ..region }, samples.clone()), (other, samples))
            }
            _ if samples.len() > 1 => {
                let middle = samples.start + 1 + random(samples.len() as u32 - 1);
                ((region, samples.start..middle), (region, middle..samples.end))
            }
            _ => {
                parts.push(Part { region, samples });
                continue;
            }
        };
        parts.extend([one, other].map(|(region, samples)| Part { region, samples }));
    }
    parts
}

#[test]
fn random_parts_in_random_order_add_up_to_the_whole_frame() {
    let whole = path();
    render(&whole, 256, &tracer(whole.frame().scene()));
    let mut count = 0;
    let mut random = |below: u32| {
        count += 1;
        mix(count) % below
    };
    for parts in [2, 5, 9] {
        let mut parts = split(Part::whole(&SETTINGS), parts, &mut random);
        let mut sum = read(&file_of(&whole, parts.swap_remove(0))).expect("sound");
        while !parts.is_empty() {
            assert_ne!(sum.header().missing(), []);
            let next = parts.swap_remove(random(parts.len() as u32) as usize);
            // A sum may be kept in a file, too.
            let mut kept = Vec::new();
            sum.write(&mut kept).expect("memory");
            sum = read(&kept).expect("sound");
            sum.add(&read(&file_of(&whole, next)).expect("sound")).expect("they fit");
        }
        assert_eq!(sum.header().missing(), []);
        assert_eq!(saved(sum.film()), saved(whole.frame().film()));
        assert_eq!(sum.header().metadata()["spp"], "6");
    }
}

#[test]
fn a_region_has_the_pixels_of_the_whole_picture() {
    let whole = path();
    render(&whole, 256, &tracer(whole.frame().scene()));
    let image = Image::of(whole.frame().film(), Region::whole(50, 40));
    for region in ["0,0,50,40", "7,9,20,25", "16,16,16,16", "49,39,1,1"] {
        let region: Region = region.parse().expect("a region");
        let cut = whole.with_part(Part { region, samples: 0..6 }).expect("a part");
        render(&cut, 256, &tracer(cut.frame().scene()));
        assert_eq!(Image::of(cut.frame().film(), region), image.clone().cropped(region));
        assert_eq!(cut.frame().film().samples(), 6 * region.area());
    }
    for wrong in [part("1,0,50,40", 0..6), part("0,0,50,40", 0..7), part("0,0,50,40", 3..3)] {
        let refused = whole.with_part(wrong.clone()).err();
        assert!(matches!(&refused, Some(SettingsError::Part { part, .. }) if *part == wrong), "{refused:?}");
    }
}

#[test]
fn films_that_do_not_belong_together_are_refused() {
    let whole = path();
    let upper = file_of(&whole, part("0,0,50,20", 0..6));
    let mut sum = read(&upper).expect("sound");
    let before = saved(sum.film());
    let refusal = sum.add(&read(&file_of(&whole, part("10,19,5,9", 2..4))).expect("sound"));
    assert_eq!(
        refusal.expect_err("they overlap").to_string(),
        "both have samples 2..4 of the region 10,19,5,1"
    );
    let lower = whole.with_part(part("0,20,50,20", 0..6)).expect("a part");
    render(&lower, 256, &tracer(lower.frame().scene()));
    let film = || Arc::clone(lower.frame().film());
    let stranger = PartialFilm::new(identity(6), lower.frame(), film()).expect("it is finished");
    let refusal = sum.add(&stranger).expect_err("another seed").to_string();
    assert_eq!(refusal, "they are of two pictures: --seed is 5 in the first and 6 in the second");
    assert_eq!(saved(sum.film()), before);
    assert_eq!(sum.header().missing(), [part("0,20,50,20", 0..6)]);
    let unfinished = PartialFilm::new(identity(5), lower.frame(), film().blank().into());
    assert!(matches!(unfinished, Err(PartialFilmError::Samples { found: 0, expected: 6000 })));
}

/// The same bytes with the right sum at their end.
fn forged(content: &[u8]) -> Vec<u8> {
    [content, &xxh3_64(content).to_le_bytes()].concat()
}

#[test]
fn damaged_and_forged_files_are_refused() {
    let file = file_of(&path(), part("0,0,50,20", 0..6));
    let told = |bytes: &[u8]| read(bytes).expect_err("refused").to_string();
    assert!(told(b"").contains("not a partial film"));
    assert!(told(b"raystream checkpoint\x04\0\0\0 and more").contains("not a partial film"));
    let version = [&file[..22], &[9, 0, 0, 0], &file[26..]].concat();
    assert!(told(&version).contains("version 9"), "{}", told(&version));
    for length in (26..file.len()).step_by(97) {
        assert!(told(&file[..length]).contains("damaged"), "cut at {length}");
    }
    for flipped in (26..file.len()).step_by(89) {
        let mut file = file.clone();
        file[flipped] ^= 0x10;
        assert!(told(&file).contains("damaged"), "byte {flipped}");
    }
    // Whoever forges the sum gets an error, not a panic.
    let content = &file[..file.len() - 8];
    let header = |from: &str, to: &str| {
        let length = u64::from_le_bytes(file[26..34].try_into().expect("eight bytes")) as usize;
        let text = std::str::from_utf8(&file[34..34 + length]).expect("JSON");
        assert!(text.contains(from), "{text}");
        let text = text.replace(from, to);
        let start = [&file[..26], &(text.len() as u64).to_le_bytes()].concat();
        forged(&[&start, text.as_bytes(), &content[34 + length..]].concat())
    };
    let huge = [&file[..26], &u64::MAX.to_le_bytes(), &content[34..]].concat();
    for wrong in [
        forged(&content[..content.len() - 50]),
        forged(&[content, b"more"].concat()),
        forged(&huge),
        forged(&file[..30]),
        header("\"width\":50", "\"width\":51"),
        header("\"width\":50", "\"width\":4294967295"),
        header("\"spp\":6", "\"spp\":5"),
        header("\"end\":6", "\"end\":5"),
        header("\"fraction_bits\":", "\"fraction_bits\":9"),
        header("\"film_bytes\":56020", "\"film_bytes\":56021"),
        header("\"film_bytes\":56020", "\"film_bytes\":56019"),
        header("\"parts\":[", "\"parts\":[]"),
    ] {
        // What has too many samples for its parts says that.
        assert!(read(&wrong).is_err());
    }
    let header = PartialFilmHeader::read(Cursor::new(header(
        "\"film_bytes\":56020",
        "\"film_bytes\":9999999999999999",
    )));
    let header = header.expect("only the film shows that it is forged");
    assert!(header.reading_bytes() > 1 << 50, "what it takes is known before it is taken");
    assert_eq!(PARTIAL_FILM_VERSION, 1);
}
