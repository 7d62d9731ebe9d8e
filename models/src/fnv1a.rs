//! A number that tells texts and files apart.

/// The hash FNV-1a of 64 bits (Fowler, Noll and Vo): not against those who seek two of the same.
pub(crate) fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
