//! Summary of several scenes.

use super::{Kind, Row};
use serde::Serialize;

/// A contender's ratios to a peer over several scenes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The kind of ray.
    pub kind: Kind,
    /// The contender.
    pub unit: String,
    /// Number of threads.
    pub threads: usize,
    /// SIMD level of raystream's CPU tracers.
    pub simd: Option<&'static str>,
    /// The peer, as in [`Row::ratio`].
    pub peer: &'static str,
    /// Number of scenes.
    pub scenes: usize,
    /// Geometric mean of the ratios.
    pub geometric_mean: f64,
    /// The least of the ratios.
    pub least: f64,
    /// The scene of the least.
    pub least_scene: String,
}

/// Geometric mean and least of every ratio to `peer`, over scenes with their rows, in the order of the first scene's
/// rows. Scenes where a contender is missing do not count for it.
pub fn summarise(scenes: &[(&str, &[Row])], peer: &'static str) -> Vec<Summary> {
    let mut summaries: Vec<Summary> = Vec::new();
    for (scene, rows) in scenes {
        for row in *rows {
            let Some(&ratio) = row.ratio.get(peer) else { continue };
            let same = |s: &&mut Summary| {
                (s.kind, &s.unit, s.threads, s.simd) == (row.kind, &row.unit, row.threads, row.simd)
            };
            match summaries.iter_mut().find(same) {
                Some(summary) => summary.add(scene, ratio),
                None => summaries.push(Summary {
                    kind: row.kind,
                    unit: row.unit.clone(),
                    threads: row.threads,
                    simd: row.simd,
                    peer,
                    scenes: 1,
                    geometric_mean: ratio,
                    least: ratio,
                    least_scene: (*scene).to_owned(),
                }),
            }
        }
    }
    summaries
}

impl Summary {
    fn add(&mut self, scene: &str, ratio: f64) {
        let before = self.scenes as f64;
        self.scenes += 1;
        let log = (self.geometric_mean.ln() * before + ratio.ln()) / self.scenes as f64;
        self.geometric_mean = log.exp();
        if ratio < self.least {
            (self.least, self.least_scene) = (ratio, scene.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Order, Spread};
    use std::collections::BTreeMap;

    fn row(unit: &str, ratio: f64) -> Row {
        Row {
            kind: Kind::Bounce,
            unit: unit.to_owned(),
            order: Order::Rows,
            threads: 1,
            simd: None,
            alpha_test: false,
            mray_per_s: Spread { median: 1.0, best: 1.0, worst: 1.0 },
            ratio: BTreeMap::from([("embree", ratio)]),
        }
    }

    #[test]
    fn the_mean_is_geometric_and_the_least_has_its_scene() {
        let rows = [
            [row("a", 2.0), row("b", 3.0)],
            [row("a", 0.5), row("c", 1.0)],
            [row("a", 27.0), row("b", 12.0)],
        ];
        let summaries = summarise(&[("x", &rows[0]), ("y", &rows[1]), ("z", &rows[2])], "embree");
        assert_eq!(
            summaries.iter().map(|s| (s.unit.as_str(), s.scenes)).collect::<Vec<_>>(),
            [("a", 3), ("b", 2), ("c", 1)]
        );
        assert!((summaries[0].geometric_mean - 3.0).abs() < 1e-12);
        assert!((summaries[1].geometric_mean - 6.0).abs() < 1e-12);
        assert_eq!((summaries[0].least, summaries[0].least_scene.as_str()), (0.5, "y"));
        assert!(summarise(&[("x", &rows[0])], "obvhs").is_empty());
    }
}
