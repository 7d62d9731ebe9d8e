//! ZIP archives and pickles, written byte by byte.

/// An entry of a ZIP archive as its directory will claim it.
pub struct Claim<'a> {
    pub name: &'a str,
    pub data: &'a [u8],
    pub method: u16,
    pub flags: u16,
    /// Places the entry at an earlier one instead of writing it.
    pub same_place_as: Option<usize>,
    /// Claims another size.
    pub size: Option<u32>,
}

impl<'a> Claim<'a> {
    pub fn new(name: &'a str, data: &'a [u8]) -> Self {
        Self { name, data, method: 0, flags: 0, same_place_as: None, size: None }
    }
}

/// An archive of honest, stored entries.
pub fn zip(entries: &[(&str, &[u8])]) -> Vec<u8> {
    claimed(&entries.iter().map(|(name, data)| Claim::new(name, data)).collect::<Vec<_>>())
}

/// An archive whose directory claims this.
pub fn claimed(entries: &[Claim<'_>]) -> Vec<u8> {
    let (mut file, mut directory, mut places) = (Vec::new(), Vec::new(), Vec::new());
    for entry in entries {
        let size = entry.size.unwrap_or(entry.data.len() as u32);
        let place = entry.same_place_as.map_or(file.len(), |i| places[i]);
        places.push(place);
        let mut common = [20, entry.flags, entry.method, 0, 0].map(u16::to_le_bytes).concat();
        common.extend([0, size, size].map(u32::to_le_bytes).concat());
        common.extend([entry.name.len() as u16, 0].map(u16::to_le_bytes).concat());
        if entry.same_place_as.is_none() {
            file.extend(b"PK\x03\x04");
            file.extend(&common);
            file.extend(entry.name.bytes());
            file.extend(entry.data);
        }
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend((place as u32).to_le_bytes());
        directory.extend(entry.name.bytes());
    }
    let start = file.len() as u32;
    file.extend(&directory);
    file.extend(b"PK\x05\x06\x00\x00\x00\x00");
    file.extend([entries.len() as u16; 2].map(u16::to_le_bytes).concat());
    file.extend([directory.len() as u32, start].map(u32::to_le_bytes).concat());
    file.extend([0, 0]);
    file
}

/// A text in a pickle.
pub fn text(text: &str) -> Vec<u8> {
    let mut bytes = b"X".to_vec();
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text.bytes());
    bytes
}

/// An integer of any size in a pickle.
pub fn int(value: i64) -> Vec<u8> {
    let mut bytes = vec![0x8a, 8];
    bytes.extend(value.to_le_bytes());
    bytes
}

/// A tuple of numbers.
pub fn tuple(values: &[i64]) -> Vec<u8> {
    let mut bytes = b"(".to_vec();
    values.iter().for_each(|v| bytes.extend(int(*v)));
    bytes.push(b't');
    bytes
}

/// The value of a tensor of `f32` in storage 0.
pub fn tensor(storage_len: i64, offset: i64, sizes: &[i64], strides: &[i64]) -> Vec<u8> {
    let storage =
        [text("storage"), b"ctorch\nFloatStorage\n".to_vec(), text("0"), text("cpu"), int(storage_len)].concat();
    [
        b"ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        storage,
        b"tQ".to_vec(),
        int(offset),
        tuple(sizes),
        tuple(strides),
        b"\x89ccollections\nOrderedDict\n)RtR".to_vec(),
    ]
    .concat()
}

/// A pickle of `{"w": value}`.
pub fn state(value: &[u8]) -> Vec<u8> {
    [b"\x80\x02}".to_vec(), text("w"), value.to_vec(), b"s.".to_vec()].concat()
}

/// A checkpoint with this pickle and a storage of four `f32`.
pub fn checkpoint(pickle: &[u8]) -> Vec<u8> {
    zip(&[("top/data.pkl", pickle), ("top/data/0", &[0; 16])])
}
