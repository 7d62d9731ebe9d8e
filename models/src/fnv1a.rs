//! A hash for telling texts and files apart.

/// The 64-bit FNV-1a hash (Fowler, Noll, Vo). It is not collision resistant against an adversary.
pub(crate) fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
