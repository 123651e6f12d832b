//! Philox4x32-10, the counter-based random number generator used everywhere.
//!
//! A draw is a pure function of a key (the seed) and a counter, so agents share no state and the result cannot
//! depend on the order in which they are served. Source: Salmon et al., "Parallel random numbers: as easy as 1, 2, 3",
//! SC 2011; the test vectors are those published with the authors' Random123 library.

const MULTIPLIER: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

/// Four 32-bit words for a 128-bit counter under a 64-bit key.
pub fn philox(counter: [u32; 4], key: u64) -> [u32; 4] {
    let mut words = counter;
    let mut round_key = [key as u32, (key >> 32) as u32];
    for round in 0..10 {
        if round > 0 {
            round_key[0] = round_key[0].wrapping_add(WEYL[0]);
            round_key[1] = round_key[1].wrapping_add(WEYL[1]);
        }
        let low = u64::from(MULTIPLIER[0]) * u64::from(words[0]);
        let high = u64::from(MULTIPLIER[1]) * u64::from(words[2]);
        words = [
            (high >> 32) as u32 ^ words[1] ^ round_key[0],
            high as u32,
            (low >> 32) as u32 ^ words[3] ^ round_key[1],
            low as u32,
        ];
    }
    words
}

/// Maps a 32-bit word to `0..bound` by the high half of a product (bias below `bound / 2^32`).
pub fn below(word: u32, bound: u32) -> u32 {
    ((u64::from(word) * u64::from(bound)) >> 32) as u32
}

/// Maps a 32-bit word to the half-open unit interval.
pub fn unit(word: u32) -> f64 {
    f64::from(word) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn matches_the_published_vectors() {
        let ones = u32::MAX;
        assert_eq!(philox([0; 4], 0), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(
            philox([ones; 4], u64::MAX),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        assert_eq!(
            philox(
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                0x299f_31d0_a409_3822
            ),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    proptest! {
        #[test]
        fn draws_stay_in_range(word: u32, bound in 1u32..) {
            prop_assert!(below(word, bound) < bound);
            prop_assert!((0.0..1.0).contains(&unit(word)));
        }
    }
}
