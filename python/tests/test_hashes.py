"""Hashes of a million answers, which `crates/rays/src/query/tests/hashes.rs` has at every SIMD level."""

import unittest

import numpy as np
import raystream as rs

CLOSED = "a47800f3d48c0a7b913fb9e77854f5a2bf0d415610199c67374d1602a18955c4"
HALF_OPEN = "f0d234e88a4fec0b6ea3b7fc9107113bb87cd98c8cee0b42692de7aa52a7890c"

EDGE = 200


def signed(i):
    """Numbers of -1 to 1 by their index."""
    x = np.asarray(i, np.uint32)
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    x = x ^ (x >> np.uint32(16))
    return (x >> np.uint32(8)).astype(np.float32) / np.float32(1 << 23) - np.float32(1)


def rough():
    """A rough plane, whose coordinates are exact."""
    i = np.arange((EDGE + 1) ** 2, dtype=np.uint32)
    x, y = ((part.astype(np.float32) - EDGE / 2) / 64 for part in (i % (EDGE + 1), i // (EDGE + 1)))
    square = np.arange(EDGE**2, dtype=np.uint32)
    at = square // EDGE * (EDGE + 1) + square % EDGE
    above = at + EDGE + 1
    faces = np.stack([np.stack([at, at + 1, above + 1], 1), np.stack([at, above + 1, above], 1)], 1)
    return np.stack([x, y, signed(i) / 16], 1).astype(np.float32), faces.reshape(-1, 3)


class Hashes(unittest.TestCase):
    def test_a_million_answers_have_the_hashes_of_rust(self):
        mesh = rs.Mesh(*rough())
        rays = signed(np.arange(6_000_000, dtype=np.uint32)).reshape(-1, 6)
        rays[:, :3] *= 2
        for rule, expected in (("closed", CLOSED), ("half-open", HALF_OPEN)):
            for threads in (1, 2):
                hits = mesh.cast(rays, want="t primitive uv normal", rule=rule, threads=threads)
                self.assertEqual(hits.hash(), expected, (rule, threads))


if __name__ == "__main__":
    unittest.main()
