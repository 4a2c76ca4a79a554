//! Probe of the most that the processor can do.
#![allow(unsafe_code)] // reason: works in registers

use super::{Line, Vector};

/// Does this number of rounds of 16 independent fused products of 16 floats, in registers.
#[inline(always)]
pub(crate) fn chained_products<V: Vector>(rounds: usize) -> f32 {
    let mut out = Line::ZERO;
    // SAFETY: called within Cpu::run alone; `out` has 16 floats.
    unsafe {
        let (a, b) = (V::splat(0.999_999), V::splat(1e-6));
        // Different and unknown beginnings, or the compiler would make one chain of sixteen, or none.
        let mut sums = [V::splat(0.0); 16];
        for (n, sum) in sums.iter_mut().enumerate() {
            *sum = V::splat(std::hint::black_box(n as f32));
        }
        for _ in 0..rounds {
            for sum in &mut sums {
                // a · sum + b, which stays between zero and its beginning.
                *sum = b.plus_product(a, *sum);
            }
        }
        for sum in sums {
            let mut line = Line::ZERO;
            sum.store(line.0.as_mut_ptr());
            out.0[0] += line.0[0];
        }
    }
    out.0[0]
}
