// SPDX-License-Identifier: GPL-3.0-or-later
//! How many threads the sums use.

/// Uses at most so many threads, 0 for as many as there are cores. Returns false where it comes too late, because
/// something has been summed in this process before.
pub fn limit(count: usize) -> bool {
    rayon::ThreadPoolBuilder::new().num_threads(count).build_global().is_ok()
}
