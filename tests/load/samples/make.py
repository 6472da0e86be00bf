#!/usr/bin/env python3
"""Makes the KTX2 files of this folder with the encoder of the package alktx2 (and zstandard): `python make.py`.

Each is an image of 16 x 12 texels: red rises from 17 to 238 with x, green from 20 to 240 with y, blue is 128, alpha is
255 in the left half and 100 in the right half. `etc1s.ktx2` is compressed by BasisLZ, `uastc.ktx2` by Zstandard,
`plain.ktx2` is UASTC alone.
"""

import pathlib
import struct

import alktx2
import zstandard

HERE = pathlib.Path(__file__).parent
WIDTH, HEIGHT = 16, 12
TEXELS = bytes(
    value
    for y in range(HEIGHT)
    for x in range(WIDTH)
    for value in (17 + 221 * x // 15, 20 + 220 * y // 11, 128, 255 if x < 8 else 100)
)
for name, codec, level in [("etc1s", "etc1s", None), ("uastc", "uastc", 19)]:
    file = alktx2.encode_raw_rgba_to_ktx2(
        TEXELS, WIDTH, HEIGHT, True, codec=codec, quality=100, effort=5, threads=1, zstd_supercompression_level=level
    )
    (HERE / f"{name}.ktx2").write_bytes(file)

# The only level lies at the end of the file.
offset, length, unpacked = struct.unpack_from("<3Q", file, 80)
level = zstandard.decompress(file[offset:offset + length], max_output_size=unpacked)
head = bytearray(file[:offset])
struct.pack_into("<I", head, 44, 0)
struct.pack_into("<3Q", head, 80, offset, unpacked, unpacked)
(HERE / "plain.ktx2").write_bytes(head + level)
