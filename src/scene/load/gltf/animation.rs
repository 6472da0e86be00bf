//! Reads animations: that of a camera, and the keys of any node.

use super::super::LoadProblem;
use super::accessor::{numbers, vectors};
use super::{Context, pose};
use crate::scene::{
    AnimatedNode, Camera, CameraMotion, Interpolate, Interpolation, Key, Track, unit_rotation,
};
use ::gltf::animation::{Channel, Interpolation as SourceInterpolation, Property, Sampler};
use ::gltf::{Accessor, Animation, Node};
use glam::{DQuat, DVec3};

/// The animation of the camera. `chain` lists the nodes from the root down to the camera's node. `None` if no
/// animation moves a node of the chain or changes the lens. If several do, the first is used.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn camera_motion(
    context: &mut Context,
    chain: &[Node],
    source: &::gltf::Camera,
    camera: Camera,
) -> Result<Option<CameraMotion>, LoadProblem> {
    let moves = |channel: &Channel| {
        let in_chain = chain.iter().any(|node| node.index() == channel.target().node().index());
        in_chain && channel.target().property() != Property::MorphTargetWeights
    };
    let (document, pointers) = (context.document, context.pointers);
    let is_moving = |animation: &Animation| {
        animation.channels().any(|channel| moves(&channel)) || pointers.lens(animation, source).is_some()
    };
    let animation = if context.session.options.animation.is_some() {
        pose::chosen(context)?.filter(is_moving)
    } else {
        let mut moving = document.animations().filter(is_moving);
        let first = moving.next();
        if moving.next().is_some() {
            context.session.warnings.add("Several animations move a camera; the first one is used.");
        }
        first
    };
    let Some(animation) = animation else { return Ok(None) };
    let mut nodes: Vec<AnimatedNode> = chain.iter().map(constant).collect();
    for channel in animation.channels().filter(moves) {
        let target = channel.target();
        let node = chain.iter().position(|node| node.index() == target.node().index());
        let node = &mut nodes[node.expect("the channel moves a node of the chain")];
        read(context, &animation, &channel, node)?;
    }
    let motion = CameraMotion::new(40.0, nodes).with_optics_of(camera);
    Ok(Some(match pointers.lens(&animation, source) {
        Some(lens) => motion.with_lens(lens.number(context, &animation)?),
        None => motion,
    }))
}

/// Reads the keys of a channel into the node that it moves. Weights of morph targets are no part of it.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn read(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    node: &mut AnimatedNode,
) -> Result<(), LoadProblem> {
    match channel.target().property() {
        Property::Translation => {
            node.translation = track::<_, 3>(context, animation, channel, DVec3::from_slice)?
        }
        Property::Scale => node.scale = track::<_, 3>(context, animation, channel, DVec3::from_slice)?,
        Property::Rotation => node.rotation = track::<_, 4>(context, animation, channel, DQuat::from_slice)?,
        Property::MorphTargetWeights => {}
    }
    Ok(())
}

/// A node that stands still.
pub(super) fn constant(node: &Node) -> AnimatedNode {
    let (translation, rotation, scale) = node.transform().decomposed();
    AnimatedNode {
        translation: Track::constant(DVec3::from_array(translation.map(f64::from))),
        rotation: Track::constant(unit_rotation(DQuat::from_array(rotation.map(f64::from)))),
        scale: Track::constant(DVec3::from_array(scale.map(f64::from))),
    }
}

/// The keys of each of a mesh's morph targets.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn weights(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    targets: usize,
) -> Result<Vec<Track<f64>>, LoadProblem> {
    let keys = Keys::read::<1>(context, animation, channel)?;
    (0..targets).map(|target| keys.track((target, targets), |numbers| numbers[0])).collect()
}

fn track<T: Interpolate, const N: usize>(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    value: fn(&[f64]) -> T,
) -> Result<Track<T>, LoadProblem> {
    Keys::read::<N>(context, animation, channel)?.track((0, 1), value)
}

/// The keys of a channel as the file has them.
pub(super) struct Keys<'a> {
    context: &'a Context<'a>,
    place: String,
    times: Vec<f64>,
    /// Values of `width` numbers each.
    values: Vec<f64>,
    width: usize,
    interpolation: Interpolation,
}

impl<'a> Keys<'a> {
    fn read<const N: usize>(
        context: &'a Context<'a>,
        animation: &Animation,
        channel: &Channel,
    ) -> Result<Self, LoadProblem> {
        let number = context.pointers.number(animation, channel.index());
        let place = format!("animations[{}].channels[{number}]", animation.index());
        let values = |accessor: &Accessor| {
            let values = vectors::<N>(context.buffers, accessor)?;
            Ok(values.as_flattened().iter().map(|number| f64::from(*number)).collect())
        };
        Self::new(context, place, &channel.sampler(), N, values)
    }

    /// The keys of a channel with a pointer, each of 1 to 4 numbers. Normalised integers are not rounded.
    ///
    /// # Errors
    /// When an accessor has another type, or cannot be read.
    pub(super) fn pointed(
        context: &'a Context<'a>,
        place: String,
        sampler: &Sampler,
        width: usize,
    ) -> Result<Self, LoadProblem> {
        Self::new(context, place, sampler, width, |accessor| numbers(context.buffers, accessor, width))
    }

    fn new(
        context: &'a Context<'a>,
        place: String,
        sampler: &Sampler,
        width: usize,
        values: impl FnOnce(&Accessor) -> Result<Vec<f64>, String>,
    ) -> Result<Self, LoadProblem> {
        let wrong = |problem: String| context.error(place.clone(), problem);
        let times =
            vectors::<1>(context.buffers, &sampler.input()).map_err(|e| wrong(format!("its input {e}")))?;
        let values = values(&sampler.output()).map_err(|e| wrong(format!("its output {e}")))?;
        let times = times.into_iter().map(|[time]| f64::from(time)).collect();
        let interpolation = match sampler.interpolation() {
            SourceInterpolation::Step => Interpolation::Step,
            SourceInterpolation::Linear => Interpolation::Linear,
            SourceInterpolation::CubicSpline => Interpolation::Cubic,
        };
        Ok(Self { context, place, times, values, width, interpolation })
    }

    /// True if each key keeps its value until the next one.
    pub(super) fn are_steps(&self) -> bool {
        self.interpolation == Interpolation::Step
    }

    /// The track of one of several values that each key has, at most of one of its numbers.
    ///
    /// # Errors
    /// When keys are missing or out of order.
    pub(super) fn track<T: Interpolate>(
        &self,
        (which, all): (usize, usize),
        value: impl Fn(&[f64]) -> T,
    ) -> Result<Track<T>, LoadProblem> {
        let parts = if self.interpolation == Interpolation::Cubic { 3 } else { 1 };
        let finite = self.values.iter().all(|number| number.is_finite());
        let numbers = parts * all * self.width;
        let is_complete = self.values.len() == numbers * self.times.len() && finite;
        // Of a cubic: all tangents before the key, all values, all tangents after it.
        let key = |key: &[f64]| {
            let of = |part: usize| value(&key[(part * all + which) * self.width..][..self.width]);
            Key { arriving: of(0), value: of(parts / 2), leaving: of(parts - 1) }
        };
        let keys = || self.values.chunks_exact(numbers).map(key).collect();
        let track = is_complete.then(|| Track::new(self.times.clone(), keys(), self.interpolation)).flatten();
        track.ok_or_else(|| {
            self.context.error(
                self.place.clone(),
                format!(
                    "has {} times and {} values; there must be {} finite values for each time, and times must \
                     increase",
                    self.times.len(),
                    self.values.len() / self.width,
                    parts * all
                ),
            )
        })
    }
}
