//! `raystream merge`: adds up partial films and writes their picture.

use super::Outcome;
use super::args::MergeArgs;
use super::outputs::Outputs;
use super::render::{insist, partial, warn_of_clamped};
use super::stats::{self, ImageStats, MergeStats, SCHEMA};
use anyhow::{Context, Result, anyhow, bail, ensure};
use raystream::film::{Format, Oidn, Picture, Region, write_picture};
use raystream::lanes::SimdLevel;
use raystream::picture::Registry;
use raystream::render::{PICTURE_VERSION, Part, PartialFilm, PartialFilmError, PartialFilmHeader};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The most gaps that a message names.
const NAMED_GAPS: usize = 8;

/// Adds up the films. All headers are compared before the first film is read, and one film is read at a time.
pub fn run(args: &MergeArgs, registry: &Registry) -> Result<Outcome> {
    let began = Instant::now();
    check_files(args)?.make_folders()?;
    let header = join_headers(args)?;
    let (width, height) = header.size();
    let whole = Region::whole(width, height);
    let region = args.region.unwrap_or(whole);
    ensure!(
        region.is_within(width, height),
        "--region {region}: the picture has the region {whole}; ask for a part of it"
    );
    let missing = Part { region, samples: 0..header.spp() }.without(header.parts());
    refuse_gaps(args, &missing)?;
    let registry = args.oidn.registry(registry);
    let asks_oidn = header.metadata().get(Picture::DENOISE).is_some_and(|name| name == "oidn");
    let oidn = (asks_oidn && args.picture_path().is_some()).then(|| registry.oidn()).transpose()?;
    let memory = header.reading_bytes().saturating_add(48 * whole.area());
    let memory = args.memory().check(format!("adding films of {width}x{height} pixels"), memory);
    memory.map_err(|error| anyhow!("{error}; raise the limit (--memory)"))?;
    let sum = add(args, &header)?;
    if let Some(path) = &args.partial {
        insist(|| partial::write(path, &sum))?;
    }
    let taken = region.area() * u64::from(header.spp()) - missing.iter().map(Part::count).sum::<u64>();
    let mean_spp = taken as f64 / region.area() as f64;
    let picture = develop(args, (&sum, oidn), region, mean_spp);
    if let Some(why) = &picture.kept_noise {
        bail!("{why}");
    }
    let (image, look) = (&picture.image, args.look.look());
    if let Some(path) = args.picture_path() {
        insist(|| write_picture(path, &picture, &look, &args.encoding.options()))?;
    }
    let identity = |what: &str| {
        let found = header.identity().iter().find(|(name, _)| *name == what);
        found.map(|(_, value)| value.to_owned()).unwrap_or_default()
    };
    let stats = MergeStats {
        schema: SCHEMA,
        image: ImageStats {
            width: region.width,
            height: region.height,
            spp: header.spp(),
            region: args.region.map(|region| [region.x, region.y, region.width, region.height]),
            samples: None,
            mean_spp,
            filter: identity("--filter"),
            indirect_limit: identity("the radiance of --clamp-indirect").parse().ok(),
            hash: picture.hash(),
            denoised_hash: picture.denoised_hash(),
            layers: picture.layer_hashes(),
            picture_version: PICTURE_VERSION,
            view: look.view().name().into(),
            exposure_stops: look.stops(image),
        },
        files: args.parts.len(),
        missing: missing.iter().map(Part::to_string).collect(),
        dropped_splats: sum.film().dropped_splats(),
        clamped_splats: sum.film().clamped_splats(),
        seconds: began.elapsed().as_secs_f64(),
        peak_memory_bytes: stats::peak_memory_bytes(),
    };
    if let Some(path) = &args.stats {
        stats::write(path, &stats)?;
    }
    print(args, &stats);
    Ok(Outcome::Done)
}

/// Refuses files that cannot be written or would overwrite others.
fn check_files(args: &MergeArgs) -> Result<Outputs> {
    if let Some(path) = args.picture_path() {
        Format::of(path)?;
        args.encoding.check(path)?;
    }
    let outputs = [
        ("-o", args.picture_path()),
        ("--partial", args.partial.as_deref()),
        ("--stats", args.stats.as_deref()),
    ];
    Outputs::check(outputs, args.parts.iter().map(|part| ("a partial film", Some(&**part))))
}

/// Reads the headers of all files and joins them.
fn join_headers(args: &MergeArgs) -> Result<PartialFilmHeader> {
    let mut joined: Option<PartialFilmHeader> = None;
    let mut seen: Vec<(&Path, PartialFilmHeader)> = Vec::new();
    for path in &args.parts {
        let name = path.display();
        let header = PartialFilmHeader::read(open(path)?).with_context(|| name.to_string())?;
        match &mut joined {
            None => joined = Some(header.clone()),
            Some(joined) => match joined.join(&header) {
                Err(PartialFilmError::Overlap { part }) => {
                    let has = |(_, other): &&(&Path, PartialFilmHeader)| {
                        other.parts().iter().any(|own| own.overlap(&part).is_some())
                    };
                    let other = seen.iter().find(has).map_or(&*args.parts[0], |(path, _)| path);
                    bail!("{name}: {part} are in {} too; leave one of the two out", other.display());
                }
                Err(PartialFilmError::Mismatch { what, first, second }) => bail!(
                    "{name}: it is of another picture than {}: {what} is {second} here and {first} there",
                    args.parts[0].display()
                ),
                joined => joined.with_context(|| name.to_string())?,
            },
        }
        seen.push((path, header));
    }
    joined.context("name at least one partial film")
}

fn open(path: &PathBuf) -> Result<BufReader<File>> {
    let file = File::open(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    ensure!(file.metadata()?.is_file(), "{}: a partial film must be a regular file", path.display());
    Ok(BufReader::new(file))
}

/// A picture with gaps is written only if that is asked for.
fn refuse_gaps(args: &MergeArgs, missing: &[Part]) -> Result<()> {
    if missing.is_empty() {
        return Ok(());
    }
    let named: Vec<String> = missing.iter().take(NAMED_GAPS).map(Part::to_string).collect();
    let more = missing.len().saturating_sub(NAMED_GAPS);
    let more = if more > 0 { format!(" and {more} more gaps") } else { String::new() };
    let gaps = format!("no partial film has {}{more}", named.join("; "));
    if args.incomplete || args.picture_path().is_none() {
        log::warn!("{gaps}");
        return Ok(());
    }
    bail!("{gaps}; render them, or ask for the picture without them (--incomplete)")
}

/// Adds up the films of all files, whose headers have been joined.
fn add(args: &MergeArgs, joined: &PartialFilmHeader) -> Result<PartialFilm> {
    let mut sum: Option<PartialFilm> = None;
    for path in &args.parts {
        let read = |path| -> Result<PartialFilm> { Ok(PartialFilm::read(open(path)?)?) };
        let film = read(path).with_context(|| path.display().to_string())?;
        match &mut sum {
            None => sum = Some(film),
            Some(sum) => sum.add(&film).with_context(|| path.display().to_string())?,
        }
    }
    let sum = sum.context("name at least one partial film")?;
    ensure!(
        sum.header().parts() == joined.parts(),
        "a partial film has changed while it was read; merge again"
    );
    Ok(sum)
}

/// The picture of a region, with the facts that the films have.
fn develop(
    args: &MergeArgs,
    (sum, oidn): (&PartialFilm, Option<&Oidn>),
    region: Region,
    mean_spp: f64,
) -> Picture {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut picture = match args.picture_path() {
        Some(_) => sum.develop_denoised(region, SimdLevel::detect(), threads, oidn),
        None => sum.develop(region),
    };
    let (image, look) = (&picture.image, args.look.look());
    let mut facts = sum.header().metadata().clone();
    let (width, height) = sum.header().size();
    for (name, value) in [
        (Picture::REGION, args.region.map(|region| region.to_string())),
        (Picture::WHOLE_SIZE, args.region.map(|_| format!("{width},{height}"))),
        ("samples", None),
        ("picture_hash", Some(picture.hash())),
        ("mean_spp", Some(mean_spp.to_string())),
        ("view", Some(look.view().name().to_owned())),
        ("exposure_stops", Some(look.stops(image).to_string())),
        ("white_balance", args.look.white_balance.map(|kelvin| kelvin.to_string())),
    ]
    .into_iter()
    .chain(picture.denoising_facts())
    {
        match value {
            Some(value) => facts.insert(name.to_owned(), value),
            None => facts.remove(name),
        };
    }
    picture.metadata = facts;
    picture
}

fn print(args: &MergeArgs, stats: &MergeStats) {
    let image = &stats.image;
    let subject = args.picture_path().or(args.partial.as_deref()).unwrap_or(Path::new("nothing"));
    stdout_line!(
        "{}: {}x{}, {} of {} spp from {} partial films, {:.1} s, hash {}",
        subject.display(),
        image.width,
        image.height,
        image.mean_spp,
        image.spp,
        stats.files,
        stats.seconds,
        image.hash
    );
    warn_of_clamped(stats.clamped_splats);
}
