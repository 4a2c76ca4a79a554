//! Lines on large pages.
//!
//! Parameters and panels are some 6 MB in hundreds of arrays, and an update walks through all of them. On pages of
//! 4 KiB they need more entries than the address cache has, and looking them up took a tenth of an update. So arrays
//! are cut from regions that the system is asked to put on pages of 2 MiB. A region lives as long as any of its arrays.
#![allow(unsafe_code)] // reason: arrays of one region that are borrowed apart

use std::fmt::{Debug, Formatter};
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, PoisonError};

use super::Line;
use super::prefetch::prefer_large_pages;

/// A large page in lines.
const PAGE: usize = (2 << 20) / size_of::<Line>();
/// The least a region has; all arrays of a learner of the paper's size fit two.
const REGION: usize = 2 * PAGE;

/// Where the next array is cut from.
static CURRENT: Mutex<Option<Region>> = Mutex::new(None);

/// Memory of a whole number of large pages, and how much of it is given away.
struct Region {
    /// Never read or written as such: it only frees the memory.
    memory: Arc<Vec<Line>>,
    /// The first line on a page of its own.
    first: NonNull<Line>,
    used: usize,
    lines: usize,
}

// SAFETY: a region hands each line out once and touches none itself.
unsafe impl Send for Region {}

impl Region {
    fn new(least: usize) -> Self {
        let lines = least.next_multiple_of(PAGE).max(REGION);
        let mut memory = Vec::<Line>::with_capacity(lines + PAGE);
        let scratch = memory.spare_capacity_mut();
        let skipped = scratch.as_ptr().align_offset(PAGE * size_of::<Line>()).min(PAGE);
        let cut = &mut scratch[skipped..skipped + lines];
        prefer_large_pages(cut.as_mut_ptr_range());
        let first = NonNull::from_mut(&mut cut[0]).cast();
        Self { memory: Arc::new(memory), first, used: 0, lines }
    }

    /// The next so many lines, zeroed, where there are as many left.
    fn cut(&mut self, len: usize) -> Option<Lines> {
        let end = self.used.checked_add(len).filter(|&end| end <= self.lines)?;
        // SAFETY: lines used..end lie within the region, are given away here alone and once, and are set before
        // anyone reads them; zeros are floats.
        let first = unsafe {
            let first = self.first.add(self.used);
            first.as_ptr().write_bytes(0, len);
            first
        };
        self.used = end;
        Some(Lines { first, len, _region: Arc::clone(&self.memory) })
    }
}

/// An array of lines, as a boxed slice, that shares its pages with its neighbours.
pub(crate) struct Lines {
    first: NonNull<Line>,
    len: usize,
    _region: Arc<Vec<Line>>,
}

// SAFETY: the lines belong to this array alone, and are floats.
unsafe impl Send for Lines {}
// SAFETY: as above; a shared array is only read.
unsafe impl Sync for Lines {}

/// This many lines of zeros.
pub(crate) fn zeroed(lines: usize) -> Lines {
    let mut current = CURRENT.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        if let Some(cut) = current.as_mut().and_then(|region| region.cut(lines)) {
            return cut;
        }
        *current = Some(Region::new(lines));
    }
}

impl Deref for Lines {
    type Target = [Line];
    #[inline(always)]
    fn deref(&self) -> &[Line] {
        // SAFETY: so many lines from there on were set, belong to this array and live as long as its region.
        unsafe { std::slice::from_raw_parts(self.first.as_ptr(), self.len) }
    }
}

impl DerefMut for Lines {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [Line] {
        // SAFETY: as for `deref`; no other array has these lines.
        unsafe { std::slice::from_raw_parts_mut(self.first.as_ptr(), self.len) }
    }
}

impl Clone for Lines {
    fn clone(&self) -> Self {
        let mut copy = zeroed(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl PartialEq for Lines {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Debug for Lines {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(&**self).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arrays of many sizes, some beyond a region, filled with their number: none must show another's.
    #[test]
    fn arrays_do_not_overlap_and_begin_with_zeros() {
        let sizes = [1, 0, 63, 2, 4096, REGION - 1, 7, REGION + 5, 500, PAGE, 31];
        let mut arrays: Vec<Lines> = sizes.iter().map(|&n| zeroed(n)).collect();
        assert!(arrays.iter().all(|a| a.iter().all(|line| *line == Line::ZERO)));
        for (n, array) in arrays.iter_mut().enumerate() {
            array.fill(Line([n as f32; 16]));
        }
        let copy = arrays[4].clone();
        arrays.remove(4);
        assert!(copy.iter().all(|line| line.0 == [4.0; 16]));
        for (array, n) in arrays.iter().zip([0, 1, 2, 3, 5, 6, 7, 8, 9, 10]) {
            assert_eq!(array.len(), sizes[n]);
            assert!(array.iter().all(|line| line.0 == [n as f32; 16]));
        }
    }
}
