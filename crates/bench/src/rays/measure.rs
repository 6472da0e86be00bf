//! Each contender's fastest order, then interleaved rounds.

use super::contender::{Contender, InOrder};
use super::{Kind, Row, Spread};
use raystream::stream::DeviceError;
use std::collections::HashMap;

/// Number of times that a contender tries each order. The faster of two tries leaves out most of what other load on the
/// machine does.
const TRIES: usize = 2;

/// Finds the order in which each contender is fastest, then times all in interleaved rounds, whatever their threads.
/// The same contender gets the same order with every number of threads.
pub fn measure(
    mut contenders: Vec<Contender<'_>>,
    rays: &[InOrder],
    kind: Kind,
    alpha_test: bool,
    rounds: usize,
) -> Result<Vec<Row>, DeviceError> {
    let mut chosen = HashMap::new();
    let mut orders = Vec::with_capacity(contenders.len());
    for contender in &mut contenders {
        let same = (contender.name.clone(), contender.simd);
        let order = match chosen.get(&same) {
            Some(&order) => order,
            None => fastest_order(contender, rays)?,
        };
        chosen.insert(same, order);
        orders.push(&rays[order]);
    }
    let mut speeds = vec![Vec::new(); contenders.len()];
    for round in 0..=rounds {
        for ((contender, rays), speeds) in contenders.iter_mut().zip(&orders).zip(&mut speeds) {
            let seconds = contender.trace(rays)?;
            // The first round warms caches and scratch memory.
            if round > 0 {
                speeds.push(contender.rays(rays).len() as f64 / seconds * 1e-6);
            }
        }
    }
    let speeds: Vec<Spread> = speeds.into_iter().map(Spread::of_rates).collect();
    let row = |((contender, rays), &mray_per_s): ((&Contender<'_>, &&InOrder), &Spread)| Row {
        kind,
        unit: contender.name.clone(),
        order: rays.order,
        threads: contender.threads,
        simd: contender.simd,
        alpha_test,
        mray_per_s,
        ratio: ratios(contender, mray_per_s.median, &contenders, &speeds),
    };
    Ok(contenders.iter().zip(&orders).zip(&speeds).map(row).collect())
}

/// The place of the order in which a contender is fastest.
fn fastest_order(contender: &mut Contender<'_>, rays: &[InOrder]) -> Result<usize, DeviceError> {
    let [first, _, ..] = rays else { return Ok(0) };
    // Scratch memory is allocated outside of the comparison.
    contender.trace(first)?;
    let (mut fastest, mut least_s) = (0, f64::INFINITY);
    for (place, rays) in rays.iter().enumerate() {
        for _ in 0..TRIES {
            let seconds = contender.trace(rays)?;
            if seconds < least_s {
                (fastest, least_s) = (place, seconds);
            }
        }
    }
    Ok(fastest)
}

/// A contender's speed against its peers': see [`Row::ratio`].
fn ratios(
    of: &Contender<'_>,
    median: f64,
    contenders: &[Contender<'_>],
    speeds: &[Spread],
) -> std::collections::BTreeMap<&'static str, f64> {
    let best = |among: &dyn Fn(&Contender<'_>) -> bool| {
        let medians = contenders.iter().zip(speeds).filter(|(unit, _)| among(unit)).map(|(_, s)| s.median);
        medians.max_by(f64::total_cmp)
    };
    let beside = |among: &dyn Fn(&Contender<'_>) -> bool| best(&|u| u.threads == of.threads && among(u));
    let has_device = contenders.iter().any(|u| u.name.starts_with("gpu: "));
    let alone = |u: &Contender<'_>| u.threads == 1 && (&u.name, u.simd) == (&of.name, of.simd);
    let peers = [
        ("embree", beside(&|u| u.name.starts_with("embree"))),
        ("embree_robust", beside(&|u| u.name.starts_with("embree") && u.is_robust)),
        ("tinybvh", beside(&|u| u.name.starts_with("tinybvh"))),
        ("obvhs", beside(&|u| u.name == "obvhs")),
        ("rtrt", beside(&|u| u.name == "rtrt")),
        ("scalar", beside(&|u| u.name == "scalar")),
        ("cpu", beside(&|u| u.name == "raystream").filter(|_| has_device)),
        ("one_thread", best(&alone).filter(|_| of.threads > 1)),
    ];
    peers.into_iter().filter_map(|(peer, other)| Some((peer, median / other?))).collect()
}
