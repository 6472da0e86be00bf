//! The loaders on files that the tests write themselves.

mod colours;
mod compressed;
mod compressed_damaged;
mod document;
mod environment;
mod folder;
mod gltf;
mod gltf_animation;
mod gltf_broken;
mod gltf_instancing;
mod gltf_materials;
mod gltf_openpbr;
mod gltf_pointer;
mod hostile;
mod instances;
mod mangled;
mod mtl;
mod mtl_openpbr;
mod obj;
mod off;
mod ply;
mod random;
mod recipe;
mod stl;
mod streams;
mod strokes;
