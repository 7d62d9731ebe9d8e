//! Buffers that no tensor uses any more, kept for the next result.
//!
//! A fresh buffer of 100 MB costs the operating system a quarter of a second of page faults; one from here costs nothing.
//! A storage gives its buffer back when its last tensor is dropped, on whatever thread that is, and
//! `backend::cpu::buffer` takes the smallest one that is large enough and not wastefully so. Buffers below 4 KiB come
//! from the system allocator, which is as fast for them.
//!
//! No memory is ever read before it was written: the operating system hands out zeros, and a buffer from here holds the
//! numbers of its last use (whatever is longer than that is filled with zeros).
//!
//! The pool is the process's and bounded: beyond [`limit`] bytes the buffers that were not used for longest go back to
//! the system. [`trim`] gives them back at once.
//!
//! ```
//! use gradreel::backend::cpu::pool;
//! use gradreel::{DType, Tensor};
//!
//! drop(Tensor::zeros([1 << 20], DType::F32));
//! assert!(pool::held() >= 4 << 20);
//! pool::trim(0);
//! assert_eq!(pool::held(), 0);
//! ```

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use bytemuck::Pod;

/// Bytes below which the system allocator serves.
const LEAST: usize = 4 << 10;

static POOL: Mutex<Pool> =
    Mutex::new(Pool { pairs: Shelf::new(), words: Shelf::new(), doubles: Shelf::new(), clock: 0 });
static LIMIT: AtomicUsize = AtomicUsize::new(usize::MAX);
static POISON: AtomicBool = AtomicBool::new(false);

/// The free buffers by the size of their elements: an allocation has to be freed with the alignment it was made with.
struct Pool {
    pairs: Shelf<u16>,
    words: Shelf<u32>,
    doubles: Shelf<u64>,
    clock: u64,
}

/// Free buffers by capacity; of equal ones the last used is last.
struct Shelf<W> {
    free: BTreeMap<usize, Vec<(u64, Vec<W>)>>,
    bytes: usize,
}

/// Bytes that wait for their next use.
///
/// ```
/// println!("{} bytes wait for their next use", gradreel::backend::cpu::pool::held());
/// ```
pub fn held() -> usize {
    pool().bytes()
}

/// Bytes that are kept at most. At first a quarter of the machine's memory (on Linux of what the control group allows),
/// or 1 GiB where that cannot be told.
///
/// ```
/// println!("{} bytes are kept at most", gradreel::backend::cpu::pool::limit());
/// ```
pub fn limit() -> usize {
    static QUARTER: OnceLock<usize> = OnceLock::new();
    match LIMIT.load(Ordering::Relaxed) {
        usize::MAX => *QUARTER.get_or_init(|| memory().map_or(1 << 30, |bytes| bytes / 4)),
        set => set,
    }
}

/// Sets the bytes that are kept at most; 0 switches the pool off.
///
/// ```
/// use gradreel::backend::cpu::pool;
/// pool::set_limit(1 << 30);
/// assert_eq!(pool::limit(), 1 << 30);
/// ```
pub fn set_limit(bytes: usize) {
    LIMIT.store(bytes, Ordering::Relaxed);
    trim(bytes);
}

/// Gives buffers back to the system until at most `bytes` are kept, those first that were not used for longest.
///
/// ```
/// gradreel::backend::cpu::pool::trim(0);
/// ```
pub fn trim(bytes: usize) {
    let evicted = pool().evict(bytes);
    // the system takes its time: without the lock
    drop(evicted);
}

/// Whether new buffers are filled with ones (NaN, for floats) at first, so that a kernel that does not write all of its
/// result is found out. For tests: it costs a pass over every result.
///
/// ```
/// use gradreel::backend::cpu::pool;
/// pool::set_poison(true); // what a kernel forgets to write is NaN
/// ```
pub fn set_poison(on: bool) {
    POISON.store(on, Ordering::Relaxed);
}

/// A vector of `len` elements of unspecified values.
pub(super) fn take<T: Pod>(len: usize) -> Vec<T> {
    let mut values = match (len * size_of::<T>() >= LEAST, size_of::<T>()) {
        (true, 2) => taken::<u16, T>(len),
        (true, 4) => taken::<u32, T>(len),
        (true, 8) => taken::<u64, T>(len),
        _ => vec![T::zeroed(); len],
    };
    if POISON.load(Ordering::Relaxed) {
        bytemuck::cast_slice_mut::<T, u8>(&mut values).fill(0xff);
    }
    values
}

/// Keeps a vector that nobody uses any more.
pub(crate) fn give<T: Pod>(values: Vec<T>) {
    let bytes = values.capacity() * size_of::<T>();
    if bytes < LEAST {
        return;
    }
    match size_of::<T>() {
        2 => given::<T, u16>(values, bytes),
        4 => given::<T, u32>(values, bytes),
        8 => given::<T, u64>(values, bytes),
        _ => {}
    }
}

fn taken<W: Word, T: Pod>(len: usize) -> Vec<T> {
    let found = W::shelf(&mut pool()).take(len);
    let mut values = found.unwrap_or_else(|| vec![W::zeroed(); class(len)]);
    values.resize(len, W::zeroed());
    match bytemuck::allocation::try_cast_vec(values) {
        Ok(values) => values,
        // a type of this size but another alignment
        Err(_) => vec![T::zeroed(); len],
    }
}

fn given<T: Pod, W: Word>(values: Vec<T>, bytes: usize) {
    let limit = limit();
    let Some(room) = limit.checked_sub(bytes) else { return };
    let Ok(values) = bytemuck::allocation::try_cast_vec::<T, W>(values) else { return };
    let mut pool = pool();
    let evicted = pool.evict(room);
    pool.clock += 1;
    let clock = pool.clock;
    W::shelf(&mut pool).give(clock, values);
    drop(pool);
    drop(evicted);
}

fn pool() -> MutexGuard<'static, Pool> {
    POOL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The elements allocated for a buffer of `len`: four sizes for each power of two, so that buffers of like sizes serve
/// each other. The system backs only the pages that are written.
fn class(len: usize) -> usize {
    len.next_multiple_of(1 << (len.ilog2() - 2))
}

/// Buffers taken out, by the size of their numbers.
type Evicted = (Vec<Vec<u16>>, Vec<Vec<u32>>, Vec<Vec<u64>>);

impl Pool {
    fn bytes(&self) -> usize {
        self.pairs.bytes + self.words.bytes + self.doubles.bytes
    }

    /// Takes out the buffers that were not used for longest until `most` bytes are left.
    fn evict(&mut self, most: usize) -> Evicted {
        let mut evicted = (Vec::new(), Vec::new(), Vec::new());
        while self.bytes() > most {
            let oldest = [self.pairs.oldest(), self.words.oldest(), self.doubles.oldest()];
            let Some((_, shelf)) = (0..3).filter_map(|i| Some((oldest[i]?.0, i))).min() else { break };
            let capacity = oldest[shelf].expect("the shelf with the minimum has one").1;
            match shelf {
                0 => evicted.0.extend(self.pairs.remove(capacity)),
                1 => evicted.1.extend(self.words.remove(capacity)),
                _ => evicted.2.extend(self.doubles.remove(capacity)),
            }
        }
        evicted
    }
}

impl<W> Shelf<W> {
    const fn new() -> Self {
        Self { free: BTreeMap::new(), bytes: 0 }
    }

    /// The smallest buffer of at least `len` and at most one and a half times as many elements.
    fn take(&mut self, len: usize) -> Option<Vec<W>> {
        let (&capacity, buffers) = self.free.range_mut(len..=len.saturating_add(len / 2)).next()?;
        let (_, values) = buffers.pop()?;
        if buffers.is_empty() {
            self.free.remove(&capacity);
        }
        self.bytes -= capacity * size_of::<W>();
        Some(values)
    }

    fn give(&mut self, clock: u64, values: Vec<W>) {
        self.bytes += values.capacity() * size_of::<W>();
        self.free.entry(values.capacity()).or_default().push((clock, values));
    }

    /// When the buffer was given back that waits longest, and its capacity.
    fn oldest(&self) -> Option<(u64, usize)> {
        self.free.iter().filter_map(|(&capacity, buffers)| Some((buffers.first()?.0, capacity))).min()
    }

    /// Takes out the buffer of this capacity that waits longest.
    fn remove(&mut self, capacity: usize) -> Option<Vec<W>> {
        let buffers = self.free.get_mut(&capacity)?;
        let (_, values) = buffers.remove(0);
        if buffers.is_empty() {
            self.free.remove(&capacity);
        }
        self.bytes -= capacity * size_of::<W>();
        Some(values)
    }
}

/// An element type that stands for all types of its size and alignment.
trait Word: Pod {
    fn shelf(pool: &mut Pool) -> &mut Shelf<Self>;
}

impl Word for u16 {
    fn shelf(pool: &mut Pool) -> &mut Shelf<Self> {
        &mut pool.pairs
    }
}

impl Word for u32 {
    fn shelf(pool: &mut Pool) -> &mut Shelf<Self> {
        &mut pool.words
    }
}

impl Word for u64 {
    fn shelf(pool: &mut Pool) -> &mut Shelf<Self> {
        &mut pool.doubles
    }
}

/// The memory that this process may use, where the operating system says so.
fn memory() -> Option<usize> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        line.trim().strip_suffix("kB")?.trim().parse::<usize>().ok()?.checked_mul(1 << 10)
    })?;
    let group = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse().ok());
    Some(group.map_or(machine, |bytes| machine.min(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_hold_what_they_are_for_and_waste_little() {
        for len in (1000..100_000).chain([1 << 20, (1 << 30) + 1]) {
            let class = class(len);
            assert!(class >= len && class as f64 <= 1.25 * len as f64, "{len}: {class}");
        }
    }

    #[test]
    fn a_shelf_gives_the_best_fit_last_used_first_and_evicts_the_oldest() {
        let mut pool = Pool { pairs: Shelf::new(), words: Shelf::new(), doubles: Shelf::new(), clock: 0 };
        for (clock, (capacity, mark)) in [(100, 1), (100, 2), (140, 3), (400, 4)].into_iter().enumerate() {
            let mut values = Vec::with_capacity(capacity);
            values.push(mark);
            pool.words.give(clock as u64, values);
        }
        pool.doubles.give(9, Vec::with_capacity(50));
        assert_eq!(pool.bytes(), 4 * 740 + 400);
        assert_eq!(pool.words.take(90).unwrap()[0], 2);
        assert_eq!(pool.words.take(101).unwrap()[0], 3);
        assert!(pool.words.take(200).is_none(), "twice the size is a waste");
        let evicted = pool.evict(2000);
        assert_eq!(evicted.1, [[1]]);
        assert_eq!(pool.bytes(), 2000);
        let evicted = pool.evict(0);
        assert_eq!((evicted.1.len(), evicted.2.len(), pool.bytes()), (1, 1, 0));
    }

    #[test]
    fn stale_numbers_may_show_but_never_less_than_asked_for() {
        // of a size that no other test uses, so that it is this one that comes back
        let len = 777_777;
        give(vec![7.5f32; len]);
        let again = take::<f32>(len + 5);
        assert_eq!(again.len(), len + 5);
        assert!(again.iter().all(|&v| v == 7.5 || v == 0.0));
        assert_eq!(take::<f64>(3), [0.0; 3]);
        assert_eq!(take::<[f32; 3]>(5000).len(), 5000);
    }
}
