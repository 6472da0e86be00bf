//! The pose of a document's nodes: at rest, or that of an animation at a time.

use super::super::LoadProblem;
use super::Context;
use super::animation::{self, constant};
use super::pointer::Owner;
use crate::scene::AnimatedNode;
use ::gltf::animation::Property;
use ::gltf::{Animation, Document, Mesh, Node};
use glam::DMat4;
use std::collections::BTreeMap;

/// Where nodes are, and how much their meshes follow their morph targets.
#[derive(Default)]
pub(super) struct Pose {
    /// The nodes that the animation moves.
    matrices: BTreeMap<usize, DMat4>,
    /// The nodes and meshes whose weights it sets.
    weights: BTreeMap<Owner, Vec<f64>>,
    /// Single weights that it sets, by their numbers.
    single: Vec<(Owner, usize, f64)>,
}

/// The name of an animation.
pub(super) fn name(animation: &Animation) -> String {
    animation.name().map_or_else(|| format!("animation {}", animation.index()), str::to_owned)
}

/// The names of a document's animations.
pub(super) fn names(document: &Document) -> Vec<String> {
    document.animations().map(|animation| name(&animation)).collect()
}

/// The animation that the options name, or else the first one. `None` if the document has none.
///
/// # Errors
/// When there is none of that name.
pub(super) fn chosen<'a>(context: &mut Context<'a>) -> Result<Option<Animation<'a>>, LoadProblem> {
    let document = context.document;
    let Some(wanted) = context.session.options.animation.clone() else {
        return Ok(document.animations().next());
    };
    let found = document.animations().find(|animation| name(animation) == wanted);
    found.map(Some).ok_or_else(|| LoadProblem::Animation {
        path: context.session.path.clone(),
        name: wanted,
        known: names(document),
    })
}

/// The time that the options choose. `None` if the pose at rest is shown.
pub(super) fn time(context: &Context) -> Option<f64> {
    let options = &context.session.options;
    options.time.or(options.animation.is_some().then_some(0.0))
}

/// True if the animation that the options choose moves more than cameras ([`shows`]). Where no time is chosen, a
/// warning tells it.
///
/// # Errors
/// When there is no animation of the name.
pub(super) fn is_animated(context: &mut Context) -> Result<bool, LoadProblem> {
    let Some(animation) = chosen(context)? else { return Ok(false) };
    let is_animated = shows(context, &animation);
    let options = &context.session.options;
    if is_animated && options.time.is_none() && options.animation.is_none() {
        let names = names(context.document).join(", ");
        context.session.warnings.add(format!(
            "The file is animated ({names}); it keeps its rest pose unless a time is chosen (--time)."
        ));
    }
    Ok(is_animated)
}

/// True if an animation moves more than cameras: meshes, lights, joints, morph targets, materials.
pub(super) fn shows(context: &Context, animation: &Animation) -> bool {
    let document = context.document;
    let mut parents = vec![None; document.nodes().len()];
    for (parent, child) in
        document.nodes().flat_map(|node| node.children().map(move |child| (node.index(), child)))
    {
        parents[child.index()] = Some(parent);
    }
    let joints =
        document.skins().flat_map(|skin| skin.joints().map(|joint| joint.index()).collect::<Vec<_>>());
    let shown = document.nodes().filter(|node| node.mesh().is_some() || node.light().is_some());
    // A node that is moved moves all that is below it. No node is below itself, or the file has been refused.
    let mut carries = vec![false; parents.len()];
    for start in shown.map(|node| node.index()).chain(joints) {
        let mut at = Some(start);
        while let Some(node) = at.filter(|node| !carries[*node]) {
            carries[node] = true;
            at = parents[node];
        }
    }
    let moves = |channel: ::gltf::animation::Channel| {
        let target = channel.target();
        target.property() == Property::MorphTargetWeights || carries[target.node().index()]
    };
    animation.channels().any(moves) || context.pointers.of(animation).any(|channel| channel.shows())
}

impl Pose {
    /// The pose that the options choose: that of an animation at a time, or the pose at rest.
    ///
    /// # Errors
    /// When there is no such animation, or keys are missing or out of order.
    pub(super) fn new(context: &mut Context) -> Result<Self, LoadProblem> {
        let animation = chosen(context)?;
        let is_named = context.session.options.animation.is_some();
        let Some(time) = time(context) else { return Ok(Self::default()) };
        let Some(animation) = animation else {
            context.session.warnings.add("The file has no animation, so it looks the same at any time.");
            return Ok(Self::default());
        };
        let names = names(context.document);
        if names.len() > 1 && !is_named {
            context.session.warnings.add(format!(
                "The file has {} animations ({}); the first one is shown.",
                names.len(),
                names.join(", ")
            ));
        }
        Self::at(context, &animation, time)
    }

    fn at(context: &Context, animation: &Animation, time: f64) -> Result<Self, LoadProblem> {
        let (mut nodes, mut weights) = (BTreeMap::<usize, AnimatedNode>::new(), BTreeMap::new());
        for channel in animation.channels() {
            let node = channel.target().node();
            if channel.target().property() == Property::MorphTargetWeights {
                let targets = node.mesh().map_or(0, |mesh| morph_targets(&mesh));
                let tracks = animation::weights(context, animation, &channel, targets)?;
                let values = tracks.iter().map(|track| track.at(time)).collect();
                weights.insert(Owner::Node(node.index()), values);
                continue;
            }
            let moved = nodes.entry(node.index()).or_insert_with(|| constant(&node));
            animation::read(context, animation, &channel, moved)?;
        }
        let mut single = Vec::new();
        for channel in context.pointers.of(animation) {
            let Some((owner, which)) = channel.weights() else { continue };
            let mesh = match owner {
                Owner::Node(node) => context.document.nodes().nth(node).and_then(|node| node.mesh()),
                Owner::Mesh(mesh) => context.document.meshes().nth(mesh),
            };
            let targets = mesh.map_or(0, |mesh| morph_targets(&mesh));
            match which {
                None => {
                    let keys = channel.keys(context, animation, 1)?;
                    let track = |target| keys.track((target, targets), |numbers| numbers[0]);
                    let values = (0..targets).map(|target| Ok(track(target)?.at(time)));
                    weights.insert(owner, values.collect::<Result<_, LoadProblem>>()?);
                }
                Some(which) if which >= targets => {
                    let problem = format!("names weight {which}, but there are {targets} morph targets");
                    return Err(context.error(channel.place(), problem));
                }
                Some(which) => single.push((owner, which, channel.number(context, animation)?.at(time))),
            }
        }
        let matrices = nodes.into_iter().map(|(node, moved)| (node, moved.matrix_at(time))).collect();
        Ok(Self { matrices, weights, single })
    }

    /// The matrix of a node that the animation moves, relative to its parent.
    pub(super) fn matrix(&self, node: &Node) -> Option<DMat4> {
        self.matrices.get(&node.index()).copied()
    }

    /// The weights of the morph targets of a node's mesh.
    pub(super) fn weights(&self, node: &Node, mesh: &Mesh) -> Vec<f64> {
        let of_file = |weights: &[f32]| weights.iter().map(|weight| f64::from(*weight)).collect();
        let node_index = Owner::Node(node.index());
        let own = self.weights.get(&node_index).cloned().or_else(|| node.weights().map(of_file));
        let mut weights = own.unwrap_or_else(|| {
            let of_mesh = Owner::Mesh(mesh.index());
            let mut weights = match self.weights.get(&of_mesh) {
                Some(animated) => animated.clone(),
                None => mesh.weights().map(of_file).unwrap_or_default(),
            };
            self.set_single(of_mesh, &mut weights);
            weights
        });
        self.set_single(node_index, &mut weights);
        weights
    }

    fn set_single(&self, of: Owner, weights: &mut Vec<f64>) {
        for &(_, which, value) in self.single.iter().filter(|(owner, ..)| *owner == of) {
            // Weights that a file leaves out are 0.
            weights.resize(weights.len().max(which + 1), 0.0);
            weights[which] = value;
        }
    }
}

/// The number of morph targets of a mesh. All of its primitives have as many.
fn morph_targets(mesh: &Mesh) -> usize {
    mesh.primitives().map(|primitive| primitive.morph_targets().count()).max().unwrap_or(0)
}
