//! Between "lanes are samples" and "lanes are features".
//!
//! Sample by sample, a panel of `F` features is `lines[(f / 16) · 32 + sample]`, each 16 features of one sample.

use super::{LANES, Line, Vector, WIDTH, Work};

/// Feature by feature to sample by sample.
pub(crate) struct ToSamples<'a> {
    /// Two lines a feature; a multiple of 16 features.
    pub(crate) features: &'a [Line],
    /// As many lines.
    pub(crate) samples: &'a mut [Line],
}

/// Sample by sample to feature by feature.
pub(crate) struct ToFeatures<'a> {
    /// 32 lines for each 16 features.
    pub(crate) samples: &'a [Line],
    /// As many lines.
    pub(crate) features: &'a mut [Line],
}

impl Work for ToSamples<'_> {
    type Output = ();
    #[inline(always)]
    #[allow(unsafe_code)] // reason: calls the vector's block transposition
    fn run<V: Vector>(self) {
        for (from, to) in self.features.as_chunks::<LANES>().0.iter().zip(self.samples.as_chunks_mut::<LANES>().0) {
            for half in 0..2 {
                let from = from[half..].as_ptr().cast();
                let to = to[half * WIDTH..].as_mut_ptr().cast();
                // SAFETY: `from` has 16 rows two lines apart that end within 32 lines; `to` 16 lines one apart.
                unsafe { V::transpose(from, 2 * WIDTH, to, WIDTH) };
            }
        }
    }
}

impl Work for ToFeatures<'_> {
    type Output = ();
    #[inline(always)]
    #[allow(unsafe_code)] // reason: calls the vector's block transposition
    fn run<V: Vector>(self) {
        for (from, to) in self.samples.as_chunks::<LANES>().0.iter().zip(self.features.as_chunks_mut::<LANES>().0) {
            for half in 0..2 {
                let from = from[half * WIDTH..].as_ptr().cast();
                let to = to[half..].as_mut_ptr().cast();
                // SAFETY: `from` has 16 lines one apart; `to` 16 rows two lines apart that end within 32 lines.
                unsafe { V::transpose(from, WIDTH, to, 2 * WIDTH) };
            }
        }
    }
}
