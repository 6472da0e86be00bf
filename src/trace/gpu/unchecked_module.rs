//! Shader modules without naga's run-time checks, for which traversal loops would pay in every iteration.
//!
//! Unsafe code. Invariants:
//! 1. The source is this crate's own (`Kernel::source`); no text from outside reaches it. Tests change its arithmetic,
//!    not its indices or loops. The kernels of `exact`, which reach the driver another way, walk by the same functions;
//!    they add to a list of undecided rays as far as it has room (`arrayLength`).
//! 2. Every index is in range. A thread beyond `Params::count` returns at once, and the caller binds at least
//!    `Params::count` rays and answers. References come from `flatten`, which makes them for nodes, pairs (as many as a
//!    leaf's reference counts) and members that it stores; `pages` splits these over all pages that it declares. A slot
//!    of a wide node is below eight, and only slots in use are visited. The words of the alpha test have a row for each
//!    primitive (`scene::alpha_words` compares the numbers), and `AlphaTable` adds only rows, materials and images that
//!    exist; integers keep a texel's column and row below the image's size, whatever floats say. The stack has an entry
//!    for every inner node on any way from the root, through a member, to a leaf: the most that a traversal pushes.
//! 3. Every loop ends. Each iteration of a traversal follows an edge of a finite tree or pops the stack, and each edge
//!    is followed at most once. A leaf has at most eight pairs of two triangles.
//! 4. No integer is divided; no task or mesh shader is used.
#![allow(unsafe_code, reason = "the invariants above")]

/// Compiles a kernel's source, whose stack has at least [`super::flatten::FlatScene::stack`] entries.
pub(super) fn module(device: &wgpu::Device, name: &str, source: String) -> wgpu::ShaderModule {
    let descriptor =
        wgpu::ShaderModuleDescriptor { label: Some(name), source: wgpu::ShaderSource::Wgsl(source.into()) };
    // SAFETY: invariants 1 to 4.
    unsafe { device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) }
}
