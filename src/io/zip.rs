//! The directory of a ZIP archive with stored entries.
//!
//! Written here rather than taken from a library: what is needed is the *places* of uncompressed entries in a mapped file,
//! and that a hostile directory is refused (entries that overlap, lie outside of the file, are compressed or encrypted, or
//! share a name), which the libraries for reading and unpacking archives leave open. There is no decompression, so there are
//! no bombs.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use crate::io::source::Source;
use crate::{Error, ErrorKind, Result};

const END: u32 = 0x0605_4b50;
const END_64: u32 = 0x0606_4b50;
const LOCATOR_64: u32 = 0x0706_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const LOCAL: u32 = 0x0403_4b50;

/// The end record and the longest comment behind it.
const LONGEST_TAIL: usize = 22 + u16::MAX as usize;
/// A directory of a checkpoint of 1 600 tensors has about 200 kB.
const LARGEST_DIRECTORY: usize = 64 << 20;

/// Where the bytes of each entry are, by name.
pub(super) fn directory(source: &Source) -> Result<BTreeMap<String, Range<usize>>> {
    let tail_at = source.len().saturating_sub(LONGEST_TAIL);
    let tail = source.read(tail_at..source.len())?;
    let end = find_end(&tail, tail_at)?;
    let (count, central) = central_directory(source, end)?;
    if central.len() > LARGEST_DIRECTORY {
        return Err(damaged(&format!("a directory of {} bytes", central.len()), central.start));
    }
    let bytes = source.read(central.clone())?;
    let mut entries = BTreeMap::new();
    let mut taken = Vec::new();
    let mut at = central.start;
    for number in 0..count {
        let place = || format!("entry {number} of {count} of the ZIP directory");
        let inside = at - central.start;
        let header = bytes.get(inside..inside + 46).and_then(|record| Fields::of(record, at, CENTRAL));
        let header = header.ok_or_else(|| damaged("no such entry", at).within(place()))?;
        let [name_len, extra_len, comment_len] = [28, 30, 32].map(|field| usize::from(header.u16(field)));
        let next = at + 46 + name_len + extra_len + comment_len;
        if next > central.end {
            return Err(damaged("an entry that runs out of the directory", at).within(place()));
        }
        let (name, extra) = bytes[inside + 46..inside + 46 + name_len + extra_len].split_at(name_len);
        let name = str::from_utf8(name);
        let name = name.map_err(|_| damaged("a name that is not UTF-8", at).within(place()))?;
        let (whole, data) = entry(source, &header, extra, central.start).map_err(|e| e.within(name))?;
        taken.push((whole, name));
        if entries.insert(name.to_owned(), data).is_some() {
            return Err(damaged("two entries of one name", at).within(name));
        }
        at = next;
    }
    taken.sort_by_key(|(range, _)| range.start);
    for pair in taken.windows(2) {
        if pair[0].0.end > pair[1].0.start {
            return Err(damaged(&format!("an entry that overlaps {}", pair[0].1), pair[1].0.start).within(pair[1].1));
        }
    }
    Ok(entries)
}

/// The range of an entry with its local header, and of its data.
fn entry(source: &Source, header: &Fields<'_>, extra: &[u8], limit: usize) -> Result<(Range<usize>, Range<usize>)> {
    if header.u16(8) & 1 != 0 {
        return Err(damaged("an encrypted entry", header.at).fix("save the file without a password"));
    }
    if header.u16(10) != 0 {
        return Err(Error::new(ErrorKind::Input, "an entry of the file is compressed")
            .found(format!("method {}", header.u16(10)))
            .wanted("stored entries, which can be read in place")
            .fix("save it again with torch.save or numpy.savez, which do not compress"));
    }
    // sizes and place: 32 bits each, or, where those are all ones, 64 bits in the extra field
    let mut wide = wide_fields(extra);
    let mut field = |offset: usize| match header.u32(offset) {
        u32::MAX => wide.next().ok_or_else(|| damaged("a ZIP64 entry without its 64-bit fields", header.at)),
        small => Ok(u64::from(small)),
    };
    let (size, packed, start) = (field(24)?, field(20)?, field(42)?);
    if size != packed {
        return Err(damaged(&format!("a stored entry with two sizes: {size} and {packed}"), header.at));
    }
    let outside = || damaged(&format!("an entry outside of the file: {size} bytes at {start}"), header.at);
    let start = usize::try_from(start).map_err(|_| outside())?;
    let size = usize::try_from(size).map_err(|_| outside())?;
    let local = record(source, start, 30)?;
    let local = local.as_deref().and_then(|local| Fields::of(local, start, LOCAL));
    let local = local.ok_or_else(|| damaged("no entry where the directory says", start))?;
    // the lengths of the local header: writers pad there, so that data starts at a multiple of 64
    let data = start + 30 + usize::from(local.u16(26)) + usize::from(local.u16(28));
    match data.checked_add(size) {
        Some(end) if end <= limit => Ok((start..end, data..end)),
        _ => Err(outside()),
    }
}

/// The 64-bit numbers of the ZIP64 extra field.
fn wide_fields(mut extra: &[u8]) -> impl Iterator<Item = u64> {
    let mut found: &[u8] = &[];
    while let [a, b, c, d, rest @ ..] = extra {
        let (id, len) = (u16::from_le_bytes([*a, *b]), usize::from(u16::from_le_bytes([*c, *d])));
        let Some((body, next)) = rest.split_at_checked(len) else { break };
        if id == 1 {
            found = body;
            break;
        }
        extra = next;
    }
    found.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b))
}

/// The end record: the last one whose comment runs to the end of the file. `tail` is the end of the file, from byte `first`.
fn find_end(tail: &[u8], first: usize) -> Result<Fields<'_>> {
    let starts = (0..=tail.len().saturating_sub(22)).rev();
    let mut ends = starts.filter_map(|at| Fields::of(tail.get(at..at + 22)?, first + at, END));
    ends.find(|end| end.at - first + 22 + usize::from(end.u16(20)) == tail.len()).ok_or_else(|| {
        damaged("no ZIP directory at its end", first + tail.len())
            .fix("copy or download the file again: it may be cut short")
    })
}

/// Number of entries, and the range of the directory.
fn central_directory(source: &Source, end: Fields<'_>) -> Result<(u64, Range<usize>)> {
    let (mut count, mut size, mut start) = (u64::from(end.u16(10)), u64::from(end.u32(12)), u64::from(end.u32(16)));
    let mut limit = end.at;
    let several = || damaged("an archive in several parts", end.at);
    if end.u16(4) != 0 && end.u16(4) != u16::MAX {
        return Err(several());
    }
    let locator = end.at.checked_sub(20).map_or(Ok(None), |at| record(source, at, 20))?;
    if let Some(locator) = locator.as_deref().and_then(|locator| Fields::of(locator, end.at - 20, LOCATOR_64)) {
        let at = usize::try_from(locator.u64(8)).unwrap_or(usize::MAX);
        let end_64 = record(source, at, 56)?;
        let end_64 = end_64.as_deref().and_then(|end_64| Fields::of(end_64, at, END_64));
        let end_64 = end_64.ok_or_else(|| damaged("no ZIP64 end record where the locator says", locator.at))?;
        if end_64.u32(16) != 0 {
            return Err(several());
        }
        (count, size, start) = (end_64.u64(32), end_64.u64(40), end_64.u64(48));
        limit = end_64.at;
    }
    let range = start.checked_add(size).and_then(|to| Some(usize::try_from(start).ok()?..usize::try_from(to).ok()?));
    match range {
        // an entry takes 46 bytes at least, so that the claimed number cannot make the reader allocate more than the file
        Some(range) if range.end <= limit && count <= size / 46 => Ok((count, range)),
        _ => Err(damaged(
            &format!("a directory that does not fit the file: {count} entries in {size} bytes at {start}"),
            end.at,
        )),
    }
}

/// The bytes of a record, if the file has as many.
fn record(source: &Source, at: usize, len: usize) -> Result<Option<Cow<'_, [u8]>>> {
    at.checked_add(len).map_or(Ok(None), |end| source.get(at..end))
}

/// A record of fixed size with a signature.
struct Fields<'a> {
    at: usize,
    record: &'a [u8],
}

impl<'a> Fields<'a> {
    fn of(record: &'a [u8], at: usize, signature: u32) -> Option<Self> {
        record.starts_with(&signature.to_le_bytes()).then_some(Self { at, record })
    }

    fn read<const N: usize>(&self, field: usize) -> [u8; N] {
        self.record[field..field + N].try_into().expect("a range of N bytes")
    }

    fn u16(&self, field: usize) -> u16 {
        u16::from_le_bytes(self.read(field))
    }

    fn u32(&self, field: usize) -> u32 {
        u32::from_le_bytes(self.read(field))
    }

    fn u64(&self, field: usize) -> u64 {
        u64::from_le_bytes(self.read(field))
    }
}

fn damaged(found: &str, at: usize) -> Error {
    Error::new(ErrorKind::Input, "the ZIP archive is damaged")
        .at(format!("byte {at}"))
        .found(found)
        .fix("copy or download the file again")
}
