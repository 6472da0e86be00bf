//! The lanes of every mask, for instruction sets that permute lanes by a table but cannot compress: AVX2 and NEON pack
//! the lanes of a mask by permuting with its entry.

/// For every mask of eight lanes the indices of its lanes in ascending order, then zeros.
pub(super) static LANES_OF: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut len) = (0, 0);
        while lane < 8 {
            if mask >> lane & 1 == 1 {
                table[mask][len] = lane as u8;
                len += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};
