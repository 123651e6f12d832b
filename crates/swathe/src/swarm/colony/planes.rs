//! Bytes of 64 cells as eight words, one for each bit of the bytes, and back.

/// Bit k of word b is bit b of byte k.
pub(super) fn planes_of(bytes: &[u8; 64]) -> [u64; 8] {
    let mut words = [[0; 8]; 8];
    for (eight, bytes) in bytes.chunks_exact(8).enumerate() {
        let block = bytes.iter().rev().fold(0, |block, &byte| block << 8 | u64::from(byte));
        for (word, byte) in words.iter_mut().zip(transposed(block).to_le_bytes()) {
            word[eight] = byte;
        }
    }
    words.map(u64::from_le_bytes)
}

/// The bytes of which [`planes_of`] makes these words.
pub(super) fn bytes_of(planes: &[u64; 8]) -> [u8; 64] {
    let words = planes.map(u64::to_le_bytes);
    let mut bytes = [0; 64];
    for (eight, bytes) in bytes.chunks_exact_mut(8).enumerate() {
        let block = u64::from_le_bytes(words.map(|word| word[eight]));
        bytes.copy_from_slice(&transposed(block).to_le_bytes());
    }
    bytes
}

/// A byte of 1 for each bit that is set.
pub(super) fn spread(word: u64) -> [u8; 64] {
    let mut bytes = [0; 64];
    for (bytes, bits) in bytes.chunks_exact_mut(8).zip(word.to_le_bytes()) {
        // Byte k keeps bit k of its copy of the bits; the sum carries whatever bit is left into the highest.
        let kept = u64::from(bits).wrapping_mul(0x0101_0101_0101_0101) & 0x8040_2010_0804_0201;
        let lifted = kept + 0x7f7f_7f7f_7f7f_7f7f;
        bytes.copy_from_slice(&(lifted >> 7 & 0x0101_0101_0101_0101).to_le_bytes());
    }
    bytes
}

/// A block of 8 x 8 bits, rows and columns swapped (Warren, "Hacker's Delight", section 7-3).
fn transposed(mut block: u64) -> u64 {
    for (shift, mask) in [
        (7, 0x00AA_00AA_00AA_00AA),
        (14, 0x0000_CCCC_0000_CCCC),
        (28, 0x0000_0000_F0F0_F0F0),
    ] {
        let swapped = (block ^ (block >> shift)) & mask;
        block ^= swapped ^ (swapped << shift);
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn planes_hold_the_bits_of_the_bytes(bytes in prop::collection::vec(any::<u8>(), 64)) {
            let bytes: [u8; 64] = bytes.try_into().unwrap();
            let planes = planes_of(&bytes);
            for (cell, byte) in bytes.iter().enumerate() {
                for (bit, plane) in planes.iter().enumerate() {
                    prop_assert_eq!(plane >> cell & 1, u64::from(byte >> bit & 1));
                }
            }
            prop_assert_eq!(bytes_of(&planes), bytes);
            for plane in planes {
                let ones = (0..64).map(|bit| (plane >> bit & 1) as u8);
                prop_assert!(spread(plane).into_iter().eq(ones));
            }
        }
    }
}
