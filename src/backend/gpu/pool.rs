//! Buffers that nobody uses any more, kept for the next result of their size.

use std::collections::HashMap;

/// Bytes that the free list keeps at most.
const MOST: u64 = 512 << 20;

/// Free buffers by size class.
#[derive(Default)]
pub(super) struct Pool {
    free: HashMap<u64, Vec<wgpu::Buffer>>,
    bytes: u64,
}

/// The size of the buffer that holds `bytes` bytes: four classes for each power of two, so that at most a fifth is
/// unused.
pub(super) fn class(bytes: usize) -> u64 {
    let bytes = bytes.max(256) as u64;
    bytes.next_multiple_of(1 << (bytes.ilog2() - 2))
}

impl Pool {
    /// A free buffer of a size class. Its contents are those of its last use.
    pub(super) fn take(&mut self, class: u64) -> Option<wgpu::Buffer> {
        let buffer = self.free.get_mut(&class)?.pop()?;
        self.bytes -= class;
        Some(buffer)
    }

    /// Keeps a buffer, unless the list is full.
    pub(super) fn give(&mut self, buffer: wgpu::Buffer) {
        let class = buffer.size();
        if self.bytes + class <= MOST {
            self.bytes += class;
            self.free.entry(class).or_default().push(buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::class;

    #[test]
    fn classes_hold_what_they_are_for_and_waste_little() {
        for bytes in (0..100_000).chain([1 << 20, (1 << 30) + 4, (1 << 32) - 4]) {
            let class = class(bytes);
            assert!(class >= bytes as u64 && class.is_multiple_of(4), "{bytes}: {class}");
            assert!(bytes < 256 || class as f64 <= 1.25 * bytes as f64, "{bytes}: {class}");
        }
    }
}
