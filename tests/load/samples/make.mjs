// Makes the Draco streams of this folder with the encoder of the package draco3dgltf: `node make.mjs`.
//
// A grid of 5 x 4 vertices, x and y in steps of 1, z = x * y / 8; normals (0, 0, 1), texture coordinates (x/4, y/3),
// colours (60 x, 80 y, 7, 255) in bytes. Attributes 0 to 3 in this order. 24 triangles.
import draco3d from "draco3dgltf";
import { writeFileSync } from "node:fs";

const [columns, rows] = [5, 4];
const vertices = Array.from({ length: columns * rows }, (_, i) => [i % columns, Math.floor(i / columns)]);
const faces = [];
for (let y = 0; y + 1 < rows; y++) {
  for (let x = 0; x + 1 < columns; x++) {
    const a = y * columns + x;
    faces.push(a, a + 1, a + columns, a + 1, a + columns + 1, a + columns);
  }
}
const module = await draco3d.createEncoderModule({});
for (const [name, method] of [
  ["edgebreaker", module.MESH_EDGEBREAKER_ENCODING],
  ["sequential", module.MESH_SEQUENTIAL_ENCODING],
]) {
  const [encoder, builder, mesh] = [new module.Encoder(), new module.MeshBuilder(), new module.Mesh()];
  builder.AddFacesToMesh(mesh, faces.length / 3, new Uint32Array(faces));
  const floats = (kind, width, f) =>
    builder.AddFloatAttributeToMesh(mesh, kind, vertices.length, width, new Float32Array(vertices.flatMap(f)));
  floats(module.POSITION, 3, ([x, y]) => [x, y, (x * y) / 8]);
  floats(module.NORMAL, 3, () => [0, 0, 1]);
  floats(module.TEX_COORD, 2, ([x, y]) => [x / 4, y / 3]);
  const colours = new Uint8Array(vertices.flatMap(([x, y]) => [60 * x, 80 * y, 7, 255]));
  builder.AddUInt8Attribute(mesh, module.COLOR, vertices.length, 4, colours);
  encoder.SetEncodingMethod(method);
  encoder.SetSpeedOptions(0, 0);
  for (const [kind, bits] of [[module.POSITION, 14], [module.NORMAL, 10], [module.TEX_COORD, 12]]) {
    encoder.SetAttributeQuantization(kind, bits);
  }
  const out = new module.DracoInt8Array();
  const length = encoder.EncodeMeshToDracoBuffer(mesh, out);
  writeFileSync(`${name}.drc`, Uint8Array.from({ length }, (_, i) => out.GetValue(i)));
}
