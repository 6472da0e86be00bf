//! The names and times of a document's animations.

use super::Context;
use super::accessor::vectors;
use super::pose::{name, shows};
use crate::scene::AnimationSpan;

/// The animations that move more than cameras, in the file's order. Of several with one name, the first can be chosen
/// and is listed. One whose keys cannot be read is left out: to choose it is an error.
pub(super) fn all(context: &Context) -> Vec<AnimationSpan> {
    let mut spans: Vec<AnimationSpan> = Vec::new();
    for animation in context.document.animations() {
        let name = name(&animation);
        if spans.iter().any(|span| span.name == name) || !shows(context, &animation) {
            continue;
        }
        let (mut first, mut last) = (f32::INFINITY, f32::NEG_INFINITY);
        for sampler in animation.samplers() {
            for [time] in vectors::<1>(context.buffers, &sampler.input()).unwrap_or_default() {
                (first, last) = (first.min(time), last.max(time));
            }
        }
        if first <= last {
            spans.push(AnimationSpan::new(name, first.into(), last.into()));
        }
    }
    spans
}
