//! Shader modules without naga's run-time checks. Traversal loops pay for the checks on every turn.
//!
//! Invariants:
//! 1. The source is this crate's own (`KernelKind::source`); no text from outside reaches it. Tests change
//!    its arithmetic, not its indices or loops.
//! 2. Every index is in range: a thread beyond `Params::count` returns at once and the caller binds
//!    at least `first + count` rays and answers; references come from `flatten`, which makes them for
//!    nodes, pairs (as many as a leaf's reference counts) and members that it lays out, `pages` splits these
//!    over all pages that it declares; a slot of a wide node is below eight, and only slots in use are
//!    visited; the stack has an entry for every inner node on any way from the root, through a member to a
//!    leaf, the most that a traversal pushes.
//! 3. Every loop ends: each turn of a traversal goes down an edge of a finite tree or takes something
//!    off the stack, and each edge is gone down at most once; a leaf has at most eight pairs of two. A ray query
//!    reports each of finitely many boxes at most once.
//! 4. No integer is divided; no task or mesh shader is used.
//! 5. A ray query is initialised once, before anything else, with finite numbers (those that `prepare` lets pass); its
//!    candidate is looked at, and an intersection generated, only after it has said that there is one, which is a box,
//!    for there is nothing else. It is not asked again when it has said that there is none.
#![allow(unsafe_code, reason = "the invariants above")]

/// Compiles a kernel's source, made with room for [`super::flatten::Flat::stack`] entries at least.
pub(super) fn module(device: &wgpu::Device, name: &str, source: String) -> wgpu::ShaderModule {
    let descriptor =
        wgpu::ShaderModuleDescriptor { label: Some(name), source: wgpu::ShaderSource::Wgsl(source.into()) };
    // SAFETY: invariants 1 to 5.
    unsafe { device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) }
}
