//! FNV-1a (Fowler, Noll, Vo): a hash that tells contents apart, not one that withstands an attacker.

/// Beginning of the hash, and factor of each step: those of 64 bits.
const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// FNV-1a of 64 bits over units of any width, bytes in the original.
///
/// # Real-time
/// A multiplication per unit: may run in the tick.
pub(crate) fn fnv1a(units: impl Iterator<Item = u64>) -> u64 {
    units.fold(OFFSET_BASIS, |hash, unit| (hash ^ unit).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three of the authors' test vectors.
    #[test]
    fn known_answers() {
        let of = |text: &str| fnv1a(text.bytes().map(u64::from));
        assert_eq!([of(""), of("a"), of("foobar")], [OFFSET_BASIS, 0xaf63_dc4c_8601_ec8c, 0x8594_4171_f739_67e8]);
    }
}
